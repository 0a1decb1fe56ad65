"""What the driver plans for a command line."""

from workflow.command_line import make_parser
from workflow.plan import plan


def planned(*arguments: str) -> dict[str, object]:
    """The workflow's configuration."""
    return plan(make_parser().parse_args(list(arguments)))
