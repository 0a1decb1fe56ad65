"""Time the learner, print the table and keep it as data; on a machine that has nothing else to do."""

from pathlib import Path

from benchmarks.learner import kernels, measure, start, summary
from srlrepro.command_line import Parser
from srlrepro.storage.files import write_table
from srlrepro.storage.provenance import processor

OUT = Path(__file__).parent.parent / "docs" / "records" / "benchmark.csv"


def main() -> None:
    """The command line."""
    parser = Parser(prog="python -m benchmarks", description=__doc__, allow_abbrev=False)
    parser.add_argument("--turns", type=int, default=15, help="of each work (default: %(default)s)")
    parser.add_argument(
        "--out", type=Path, default=OUT, help="table to write (default: docs/records/benchmark.csv)"
    )
    arguments = parser.parse_args()
    if arguments.turns < 1:
        parser.error(f"--turns = {arguments.turns}: must be a whole number in [1, inf)")
    table = summary([*measure(arguments.turns), *kernels(arguments.turns), start()])
    table["processor"] = processor()
    write_table(arguments.out, table, digits=4)
    print(table.to_string(index=False, float_format="{:.3g}".format))


main()
