"""Long cases of tests/saltus/test_response_catalogues.py."""

from branches.catalogue import Catalogue
from tests.saltus import test_response_catalogues as origin
from tests.saltus.running import run
from tests.saltus.test_response_catalogues import SMALL

small = origin.small


def test_an_interrupted_build_goes_on(small, capsys, tmp_path, monkeypatch):
    """Oracle: the catalogue of a build that was not interrupted."""
    from branches.building import responses

    real_work, calls = responses.follow_seed, []

    def work(*arguments):
        calls.append(arguments)
        if len(calls) == 3:
            raise KeyboardInterrupt
        return real_work(*arguments)

    place = str(tmp_path / "part.sqlite")
    words = "build", *SMALL, "--depth", "2", "--catalogue", place
    monkeypatch.setattr(responses, "follow_seed", work)
    code, out, err = run(capsys, *words)
    assert code == 130 and "keeps what was finished" in err
    code, _, err = run(capsys, *words[:-4], "--depth", "1", "--catalogue", place)
    assert code == 2 and "depth 2 is not finished" in err and "received -0.1:0.06, depth 1" in err
    assert 0 < run(capsys, "list", "--catalogue", place)[1].count("\n") < 6
    assert run(capsys, *words)[0] == 0
    with Catalogue(small) as whole, Catalogue(place) as other:
        assert whole.counts() == other.counts()
        assert [row.id for row in whole.all_families()] == [row.id for row in other.all_families()]
