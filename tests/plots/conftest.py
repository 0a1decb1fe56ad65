"""What the tests of plots share."""

import matplotlib.pyplot as plt
import pytest


@pytest.fixture(autouse=True)
def close_figures() -> None:
    """Leave no figure of another test open."""
    plt.close("all")
