"""Bad input: one line on standard error that says what was wrong and what was expected, exit code 2, nothing started."""

import subprocess
import sys

import pytest

from saltus.__main__ import main
from tests.saltus.running import refused, run

ONE_SIDED = """
[system]
mass = [[1.0]]
stiffness = [[1.0]]
[[stops]]
c = [1.0]
upper = 0.5
[bounds]
energy = [0.1, 10]
quarter_period = 8
impacts = 6
"""

INDEFINITE = ONE_SIDED.replace("mass = [[1.0]]", "mass = [[1.0, 2.0], [2.0, 1.0]]")
INDEFINITE = INDEFINITE.replace("[[1.0]]", "[[1.0, 0.0], [0.0, 1.0]]")
UNEVEN = INDEFINITE.replace("[[1.0, 2.0], [2.0, 1.0]]", "[[1.0, 0.0], [0.0, 1.0]]")
UNEVEN = UNEVEN.replace("c = [1.0]", "c = [1.0, -1.0]\nlower = -1.0")
DAMPED = ONE_SIDED.replace("[system]", "[system]\ndamping = [[0.1]]").replace("upper", "lower = -0.5\nupper")

FORCED = """
[system]
model = "vibro_impact_nes"
[[forces]]
on = "u2"
amplitude = 0.5
frequency = 1.0
[bounds]
energy = [0.1, 10]
quarter_period = 8
impacts = 6
"""

CASES = [
    # a label that does not parse: points at the character
    ("continue S1x", ["S1x", "character 3", "half-waves"]),
    ("continue X13O00+", ["X13O00+", "character 1", "S", "U", "L"]),
    ("continue S13O00+@energy=1", ["character 9", "h=..", "alpha=.."]),
    ("orbit S13O0 --energy 1", ["S13O0", "character 6"]),
    # a label that parses but cannot be: says why
    ("continue S13E01+", ["S13E01+", "cannot be", "0 and 1"]),
    ("continue S23O00+", ["S23O00+", "odd"]),
    ("continue U2100-", ["U2100-", "no impact"]),
    # a label that no orbit has in the range: what was searched, the nearest that exists
    ("continue S13O00- --energy 0.1:1", ["S13O00-", "0.1", "1", "nearest"]),
    ("orbit S13O00+ --energy 0.01", ["S13O00+", "0.01", "0.1185078"]),
    ("continue U3401 --energy 0.1:0.14", ["U3401", "nearest that exist", "U3201-@h="]),
    ("orbit U3401 --energy 0.13", ["U3401", "nearest that exist", "U3201-@h="]),
    ("continue L22-", ["L22- is the 2-fold cover of L11-"]),
    ("continue S39O11+ --energy 0.2:2", ["3-fold cover of S13O00+"]),
    # a label that several families have
    ("continue S73O33- --mu 0.1000001", ["S73O33-", "@h="]),
    # a suffix that selects none of the orbits that exist
    ("continue S13O00+@h=0.5,alpha=5", ["h = 0.5, alpha = 5", "S13O00+@h=0.5,alpha=1.70698"]),
    ("continue S13O00+@alpha=5", ["alpha = 5", "1.64016:1.83867"]),
    ("orbit S13O00+@h=0.5 --energy 0.7", ["S13O00+@h=0.5", "h = 0.5", "--energy", "0.7", "one of them"]),
    ("orbit S13O00+@h=0.5,alpha=1.7 --alpha 1.75", ["alpha = 1.7", "--alpha", "1.75", "one of them"]),
    # parameters
    ("continue S13O00+ --mu 0", ["mu, the mass ratio, must be above 0", "0"]),
    ("continue S13O00+ --mu -0.1", ["mu, the mass ratio, must be above 0", "-0.1"]),
    ("continue S13O00+ --mu inf", ["mu", "finite"]),
    ("continue S13O00+ --mu nan", ["mu", "'nan'", "a number"]),
    ("continue S13O00+ --mu 1e-300", ["mu", "too small", "1e-300", "1e-25 to 1e+25"]),
    ("continue S13O00+ --mu 1e-320", ["mu", "too small", "1e-25 to 1e+25"]),
    ("continue S13O00+ --sigma 1e300", ["sigma", "too large", "1e+300", "a size from 0 to 1e+25"]),
    ("continue S13O00+ --mu abc", ["mu", "'abc'", "a number"]),
    ("continue S13O00+ --sigma -1", ["sigma, the coupling stiffness, must be 0 or above", "-1"]),
    ("continue S13O00+ --sigma nan", ["sigma", "'nan'", "a number"]),
    ("continue S13O00+ --rho 1.5", ["rho, the restitution, lies in [0, 1]", "1.5"]),
    ("continue S13O00+ --rho -0.5", ["rho, the restitution, lies in [0, 1]", "-0.5"]),
    ("continue S13O00+ --rho nan", ["rho", "'nan'", "a number"]),
    ("continue S13O00+ --lam -0.5", ["lam, the damping, must be 0 or above", "-0.5"]),
    # what is not conservative
    ("continue S13O00+ --rho 0.7", ["restitution 0.7", "stop a", "saltus run"]),
    ("continue S13O00+ --lam 0.01", ["damping", "0.01"]),
    ("orbit S13O00+ --energy 1 --rho 0.7", ["restitution 0.7", "stop a"]),
    ("continue S13O00+ --scene {damped}", ["damping", "0.1"]),
    # energy ranges
    ("continue S13O00+ --energy 2:1", ["'2:1'", "LO:HI with 0 < LO < HI"]),
    ("continue S13O00+ --energy 1:1", ["'1:1'", "LO:HI"]),
    ("continue S13O00+ --energy -1:2", ["'-1:2'", "LO:HI"]),
    ("continue S13O00+ --energy nan:2", ["'nan:2'", "LO:HI"]),
    ("continue S13O00+ --energy 1:inf", ["'1:inf'", "LO:HI"]),
    ("continue S13O00+ --energy 1", ["'1'", "LO:HI"]),
    ("continue S13O00+ --energy a:b", ["'a:b'", "LO:HI"]),
    ("orbit S13O00+ --energy -1", ["'-1'", "above 0"]),
    ("orbit S13O00+ --alpha nan", ["'nan'", "a number"]),
    ("orbit S13O00+", ["--energy", "--alpha"]),
    # files
    ("continue S13O00+ --json {missing}/a.json", ["cannot write", "directory", "does not exist"]),
    ("continue S13O00+ --csv {here}", ["cannot write", "is a directory"]),
    ("continue S13O00+ --plot {here}/a.pgn", ["'pgn'", "nearest: png"]),
    ("continue S13O00+ --plot {here}/a", ["no figure format", "png, pdf or svg"]),
    ("continue S13O00+ --plot {missing}/a.png", ["cannot write", "does not exist"]),
    ("continue S13O00+ --plot -", ["no figure format of '-'", "png, pdf or svg"]),
    ("continue S13O00+ --json - --csv -", ["--json", "--csv", "standard output"]),
    ("continue S13O00+ --json {here}/a --csv {here}/a", ["--json", "--csv", "both"]),
    # scenes
    ("continue S13O00+ --scene {unknown}", ["unknown key 'stifness'", "nearest known: stiffness"]),
    ("continue S13O00+ --scene=", ["scene", "it is a directory"]),
    ("continue S13O00+ --scene {text}", ["as TOML", "line 1", "column"]),
    ("continue S13O00+ --scene {here}", ["cannot read scene", "it is a directory"]),
    ("continue S13O00+ --scene {here}/gone.toml", ["gone.toml", "does not exist"]),
    ("continue S13O00+ --scene {indefinite}", ["mass", "positive definite"]),
    ("continue S13O00+ --scene {asymmetric}", ["mass", "symmetric"]),
    ("continue S13O00+ --scene {one_sided} --mu 0.1", ["mu", "matrices"]),
    # origin ends without odd symmetry
    ("continue S13O00+ --scene {uneven}", ["S13O00+ starts at the origin", "equal gaps", "from -1 to 0.5;", "the id of a", "saltus build"]),
    ("continue periodic:++:dd737b71 --scene {uneven}", ["periodic:++:dd737b71", "without a reversal", "--catalogue FILE"]),
    ("continue rest-rest:+:dc2855cb --scene {one_sided}", ["two degrees of freedom", "this system has 1", "--catalogue FILE"]),
    # loads that a command does not use
    ("continue S13O00+ --scene {forced}", ["saltus continue", "without loads", "[[forces]]", "saltus run"]),
    ("orbit S13O00+ --energy 1 --scene {forced}", ["saltus orbit", "[[forces]]"]),
    ("discover --energy 1 --scene {forced}", ["saltus discover", "[[forces]]"]),
    ("section --energy 1 --scene {forced}", ["saltus section", "[[forces]]"]),
    ("impulsive --energy 1:2 --scene {forced}", ["saltus impulsive", "[[forces]]"]),
    ("build --scene {forced} --catalogue {here}/a.sqlite", ["saltus build", "[[forces]]"]),
    ("list --scene {forced}", ["saltus list", "[[forces]]"]),
    ("tree S13O00+ --scene {forced}", ["saltus tree", "[[forces]]"]),
    ("export fep --plot {here}/a.png --scene {forced}", ["saltus export", "[[forces]]"]),
    ("export points --csv {here}/a.csv --scene {forced}", ["saltus export", "[[forces]]"]),
    ("section --energy 1 --scene {shaken}", ["saltus section", "[ground]"]),
    ("continue S13O00+ --scene {extreme}", ["entry (1, 1) of mass", "too small", "1e-300"]),
    ("continue S13O00+ --scene {twice}", ["coordinates have different names", "('x', 'x')"]),
    # discovery
    ("discover", ["--energy"]),
    ("discover --energy 0", ["--energy", "'0'", "above 0"]),
    ("discover --energy -2", ["--energy", "'-2'", "above 0"]),
    ("discover --energy nan", ["--energy", "'nan'", "a number"]),
    ("discover --energy 1 --max-quarter-period -1", ["--max-quarter-period", "'-1'", "above 0"]),
    ("discover --energy 1 --max-impacts -1", ["--max-impacts", "'-1'", "above 0"]),
    ("discover --energy 1 --max-impacts 0", ["--max-impacts", "'0'", "above 0"]),
    ("discover --energy 1 --max-impacts 200000", ["200000", "from 0 to 10000, or no bound"]),
    ("discover --energy 1 --max-impacts 100000000000000000000000", ["--max-impacts", "up to 1e15"]),
    ("build --max-impacts 200000 --catalogue {here}/a.sqlite", ["200000", "from 0 to 10000"]),
    ("discover --energy 1 --max-impacts 2.5", ["--max-impacts", "'2.5'", "integer"]),
    ("discover --energy 1 --ends rest-sop", ["'rest-sop'", "nearest: rest-stop"]),
    ("discover --energy 1 --ends origin-origin,", ["unknown ends ''"]),
    ("discover --energy 1 --rho 0.7", ["restitution 0.7", "stop a"]),
    ("discover --energy 1 --scene {one_sided}", ["two degrees of freedom", "this system has 1"]),
    ("discover --energy 1 --ends origin-origin --scene {uneven}", ["origin-origin", "odd symmetry", "rest-rest"]),
    ("discover --energy 1 --json {missing}/a.json", ["cannot write", "does not exist"]),
    # words of the command line
    ("contnue S13O00+", ["'contnue'", "nearest: continue"]),
    ("continue", ["NAME"]),
    ("continue S13O00+ --enrgy 1:2", ["--enrgy", "nearest: --energy"]),
    ("continue S13O00+ more", ["'more'"]),
    ("continue S13O00+ --points 0", ["--points", "'0'", "above 0"]),
    ("continue S13O00+ --points 2.5", ["--points", "'2.5'", "integer"]),
    ("continue S13O00+ --direction upp", ["--direction", "'upp'", "nearest: up"]),
    ("continue S13O00+ --frequency indexx", ["--frequency", "nearest: index"]),
    ("continue S13O00+ --stop-at sn", ["--stop-at", "'sn'", "nearest: SN"]),
    ("continue S13O00+ --model=3", ["--model", "ignored explicit argument '3'"]),
    ("--versoin", ["--versoin", "nearest: --version"]),
]


@pytest.fixture
def places(tmp_path):
    """Files and directories that the cases name."""
    texts = {
        "unknown": ONE_SIDED.replace("stiffness", "stifness"),
        "text": "h,alpha\n",
        "indefinite": INDEFINITE,
        "asymmetric": INDEFINITE.replace("[2.0, 1.0]", "[0.5, 1.0]"),
        "one_sided": ONE_SIDED,
        "damped": DAMPED,
        "uneven": UNEVEN,
        "forced": FORCED,
        "shaken": UNEVEN + '[ground]\namplitude = 1.0\nfrequency = 2.0\n',
        "extreme": UNEVEN.replace("[[1.0, 0.0]", "[[1e-300, 0.0]", 1),
        "twice": UNEVEN + '[coordinates]\nnames = ["x", "x"]\n',
    }
    for name, text in texts.items():
        (tmp_path / f"{name}.toml").write_text(text)
    return {"here": tmp_path, "missing": tmp_path / "missing", **{name: tmp_path / f"{name}.toml" for name in texts}}


@pytest.mark.parametrize(("words", "expected"), CASES, ids=[words for words, _ in CASES])
def test_one_line_and_exit_code_2(capsys, places, words, expected):
    """Oracle: the input; each message holds what was received and what was expected."""
    before = sorted(entry.name for entry in places["here"].iterdir())
    refused(run(capsys, *words.format(**places).split()), *expected)
    assert sorted(entry.name for entry in places["here"].iterdir()) == before


def test_what_stands_after_two_hyphens_is_no_option(capsys):
    """Oracle: argparse's reading of what is after two hyphens; of several unknown options, the first one is named."""
    refused(run(capsys, "continue", "S13O00+", "--", "--energy", "0.3:0.4"), "unexpected argument '--energy'")
    refused(run(capsys, "continue", "S13O00+", "--enrgy=1:2", "--", "x"), "unknown option --enrgy", "nearest: --energy")


def test_two_hyphens_are_no_value_of_an_option(capsys):
    """Oracle: argparse reads --option=-- as an empty list, whatever kind the option has."""
    refused(run(capsys, "list", "--json=--"), "--json=--: -- is not a value of an option")


def test_the_process_ends_with_the_code():
    """Oracle: exit code 2, one line, no traceback."""
    done = subprocess.run([sys.executable, "-m", "saltus", "continue", "S1x"], capture_output=True, text=True)
    assert done.returncode == 2 and done.stdout == "" and len(done.stderr.splitlines()) == 1


def test_a_fault_of_the_program_is_not_called_bad_input(monkeypatch):
    """Oracle: the error itself: a `KeyError` is no fault of the user's."""

    def fail(*arguments, **options):
        raise KeyError("h")

    monkeypatch.setattr("saltus.families.trace", fail)
    with pytest.raises(KeyError):
        main(["continue", "S13O00+"])
