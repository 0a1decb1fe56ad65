"""The studies beside the paper's grid, as universes that the workflow runs one by one."""

from typing import Any

from replication.studies.alternatives import ORACLES
from replication.studies.multiverse import design, load, settings
from srlrepro.settings.choices import Choices

FEW = 6  # universes of a quick multiverse, at most
HYPOTHESES = tuple(Choices.__dataclass_fields__["hypothesis"].metadata["allowed"].split("|"))
NO_DATA = "1"  # stands for α where a hypothesis knows the system and learns from no data


def jobs(study: str, alphas: list[str], seeds: list[int], few: bool) -> dict[str, dict[str, Any]]:
    """{id of a universe: the parameters of its notebook that differ between universes}.

    Args:
        study: "multiverse": one universe for every row of its `design`, each with seeds of its own;
            "hypotheses": one for each of `HYPOTHESES`, the paper's with the free learner, which has none.
        alphas: conditions of the grid, as texts.
        seeds: of the learner.
        few: only some universes of a multiverse, spread over its design.
    """
    if study == "hypotheses":
        return {name: _hypothesis(name, alphas, seeds) for name in HYPOTHESES}
    choices = load()
    universes = design(choices)
    if few:
        universes = universes.iloc[:: -(-len(universes) // FEW)]
    found = {}
    for name, levels in universes.iterrows():
        values = settings(choices, levels.to_dict())
        drawn = {"DATA_SEED": values.pop("data_seed", 0), "SEEDS": [values.pop("seed", 0)]}
        found[str(name)] = {"ID": str(name), "ALPHAS": alphas, "SETTINGS": values} | drawn
    return found


def _hypothesis(name: str, alphas: list[str], seeds: list[int]) -> dict[str, Any]:
    conditions = alphas if name == Choices.hypothesis else [alpha for alpha in alphas if alpha != "none"]
    if name in ORACLES:
        conditions = [NO_DATA]
    return {
        "ID": name,
        "ALPHAS": conditions,
        "SETTINGS": {"hypothesis": name},
        "DATA_SEED": 0,
        "SEEDS": seeds,
    }
