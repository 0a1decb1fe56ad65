"""README.md says what the results and the configuration say."""

from srlrepro import readme


def test_readme_is_up_to_date() -> None:
    assert not readme.is_stale(), "run: python -m srlrepro readme"


def test_a_changed_result_makes_it_stale(monkeypatch) -> None:
    values = readme.context()
    values["run"]["minutes"] += 1
    monkeypatch.setattr(readme, "context", lambda: values)
    assert readme.is_stale()
