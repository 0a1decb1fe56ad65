"""What the driver plans for a command line."""

from srlrepro.plan import make_parser, plan


def planned(*arguments: str) -> dict[str, object]:
    """The workflow's configuration."""
    return plan(make_parser().parse_args(list(arguments)))
