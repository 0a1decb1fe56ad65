"""The studies beside the paper's grid, as universes that the workflow runs one by one."""

from typing import Any

from srlrepro.multiverse import design, load, settings

FEW = 6  # universes of a quick multiverse


def jobs(study: str, alphas: list[str], seeds: list[int], few: bool) -> dict[str, dict[str, Any]]:
    """{id of a universe: the parameters of its notebook that differ between universes}.

    Args:
        study: "multiverse": one universe for every row of its `design`, each with a seed of its own.
        alphas: conditions of the grid, as texts.
        seeds: of the learner.
        few: only some universes of a multiverse, spread over its design.
    """
    choices = load()
    universes = design(choices)
    if few:
        universes = universes.iloc[:: len(universes) // (FEW - 1)]
    found = {}
    for name, levels in universes.iterrows():
        values = settings(choices, levels.to_dict())
        drawn = {"DATA_SEED": values.pop("data_seed", 0), "SEEDS": [values.pop("seed", 0)]}
        found[str(name)] = {"ID": str(name), "ALPHAS": alphas, "SETTINGS": values} | drawn
    return found
