r"""The pendulum's equations of motion as JavaScript, derived from its energies.

The point mass m_i sits in the middle of link i. With the absolute angles φ_i = θ1 + … + θ_i, clockwise, it is
at r_i = Σ_{j<i} l_j (sin φ_j, cos φ_j) + ½ l_i (sin φ_i, cos φ_i). From T = ½ Σ_i m_i ‖ṙ_i‖² and
V = g Σ_i m_i r_iy follow Lagrange's equations M(φ) φ̈ = F(φ, φ̇, u), where joint i does work on φ_i − φ_{i−1}.

Nothing is copied from the compiled kernel: the page has its equations by a second way, and a test holds both
to each other.
"""

import sympy as sp
from sympy.printing.jscode import JavascriptCodePrinter


class _Printer(JavascriptCodePrinter):  # type: ignore[misc]
    """Writes squares as products, which engines compute faster than ``Math.pow``."""

    def _print_Pow(self, expr: sp.Pow) -> str:  # noqa: N802
        if expr.exp == 2:
            return "({0}*{0})".format(self._print(expr.base))
        return str(super()._print_Pow(expr))


def motion(links: int) -> str:
    """The JavaScript function ``motion(s, x, u, mass, force)`` of a pendulum with so many links.

    It fills M [n·n] and F [n] of the state x [2n] under the torques u [n], in kg·m² and N·m; ``s`` has the
    ``masses`` [n] in kg, the ``lengths`` [n] in m, and ``gravity`` in m/s².
    """
    n = range(links)
    names = [[f"{name}{i + 1}" for i in n] for name in ("phi", "rate", "u", "m", "l")]
    phi, rate, u, m, l = (sp.symbols(row) for row in names)
    g, half = sp.Symbol("g"), sp.Rational(1, 2)
    kinetic = potential = sp.Integer(0)
    for i in n:
        arms = [*l[:i], half * l[i]]
        speed = [
            sum(a * turn(p) * w for a, p, w in zip(arms, phi, rate, strict=False))
            for turn in (sp.cos, sp.sin)
        ]
        kinetic += half * m[i] * (speed[0] ** 2 + speed[1] ** 2)
        potential += g * m[i] * sum(a * sp.cos(p) for a, p in zip(arms, phi, strict=False))
    momentum = [sp.diff(kinetic, w) for w in rate]
    matrix = [sp.diff(p, w) for p in momentum for w in rate]
    work = [u[i] - (u[i + 1] if i + 1 < links else 0) for i in n]
    force = [
        work[i]
        - sum(sp.diff(momentum[i], phi[k]) * rate[k] for k in n)
        + sp.diff(kinetic - potential, phi[i])
        for i in n
    ]
    shared, parts = sp.cse([sp.simplify(e) for e in (*matrix, *force)], sp.numbered_symbols("v"))
    write = _Printer().doprint
    lines = ["function motion(s, x, u, mass, force) {"]
    for i in n:
        before = f"phi{i} + ", f"rate{i} + "
        for name, place, head in (("phi", i, before[0]), ("rate", links + i, before[1])):
            lines.append(f"  const {name}{i + 1} = {head if i else ''}x[{place}];")
        lines.append(f"  const u{i + 1} = u[{i}], m{i + 1} = s.masses[{i}], l{i + 1} = s.lengths[{i}];")
    lines.append("  const g = s.gravity;")
    lines += [f"  const {symbol} = {write(value)};" for symbol, value in shared]
    lines += [f"  mass[{i}] = {write(part)};" for i, part in enumerate(parts[: links**2])]
    lines += [f"  force[{i}] = {write(part)};" for i, part in enumerate(parts[links**2 :])]
    return "\n".join([*lines, "}"])
