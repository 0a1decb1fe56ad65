"""What a file of training data or of a region was made of, so that no result is taken for another."""

import json
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from srlrepro.pins import ARITHMETIC
from srlrepro.settings.condition import MOST_SEED, check_share
from srlrepro.settings.config import Config
from srlrepro.settings.fields import check, check_whole
from srlrepro.storage.files import ResultError, parse_json


@dataclass(frozen=True)
class MadeOf:
    """What training data, or a region learned from them, depend on."""

    alpha: float  # share of UD in the data
    seed: int  # of the data
    values: dict[str, Any]  # {name: value} of the parameters (`Config.until` the stage)
    arithmetic: int = ARITHMETIC  # its number (`srlrepro.pins`); 0: before there were any


def write_made_of(made_of: MadeOf | None) -> str:
    """As text, to be kept in a file; of what was made by hand, "null"."""
    return json.dumps(None if made_of is None else asdict(made_of), ensure_ascii=False)


def read_made_of(text: Any, stage: str, path: Path) -> MadeOf | None:
    """What `write_made_of` wrote for a result of a stage.

    Raises:
        ResultError: the text says anything but α, a seed and allowed values of all parameters of the stage.
    """
    try:
        told = parse_json(str(text))
        if told is None:
            return None
        found = MadeOf(**{"arithmetic": 0} | told)
        check_whole("arithmetic", found.arithmetic, 0)
        check_share(found.alpha)
        check_whole("seed", found.seed, 0, MOST_SEED)
        if Config().with_values(**found.values).until(stage) != found.values:
            raise ValueError(f"{stage} depends on other parameters")
    except (ValueError, TypeError) as error:
        raise ResultError(f"{path} does not say well what it was made of: {error}") from error
    return found


def require_made_of(
    made_of: MadeOf | None, config: Config, stage: str, *, where: Any, **of_data: float | None
) -> None:
    """See that a result of a stage was made of what is asked for.

    Args:
        where: the file, as a refusal names it.
        of_data: alpha, seed of the data; None or left out: any.

    Raises:
        ParameterError: it was made with another value, or does not say with which.
    """
    check(made_of is not None, stage, where, "one that says what it was made of, not one made by hand")
    assert made_of is not None
    found = {name: value for name, value in vars(made_of).items() if name != "values"} | made_of.values
    for name, value in (of_data | {"arithmetic": ARITHMETIC} | config.until(stage)).items():
        same = value is None or value == found.get(name)
        check(same, name, value, f"{found.get(name)}, with which {where} was made")
