"""Bad input: one line on standard error that says what was wrong and what was expected, exit code 2, nothing started."""

import os
import subprocess
import sys

import pytest

import saltus
from saltus.__main__ import main
from tests.branches.catalogue.families import real
from tests.saltus.running import refused, run
from tests.saltus.test_scene_loads import SCENE as BUILDING

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

UNEVEN = ONE_SIDED.replace("[[1.0]]", "[[1.0, 0.0], [0.0, 1.0]]").replace("c = [1.0]", "c = [1.0, -1.0]\nlower = -1.0")
DAMPED = ONE_SIDED.replace("[system]", "[system]\ndamping = [[0.1]]").replace("upper", "lower = -0.5\nupper")

SOFTENING = """
title = "x'' + x - x^3 = 0"
[system]
mass = [[1.0]]
stiffness = [[1.0]]
[coordinates]
names = ["x"]
[[springs]]
on = "x"
stiffness = -1.0
power = 3
"""
CURL = """
title = "A force on x that y moves"
[system]
mass = [[1.0, 0.0], [0.0, 1.0]]
stiffness = [[2.0, -1.0], [-1.0, 2.0]]
[coordinates]
names = ["x", "y"]
[[springs]]
on = "x"
force = "y**3"
"""
TWO = ONE_SIDED.replace("[[1.0]]", "[[1.0, 0.0], [0.0, 1.0]]").replace("c = [1.0]", "c = [1.0, 0.0]\nlower = 0.3")
MARKED = '[coordinates]\nLO = "u2"\n'

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

PUSHED = "[parameters]\nf = 0.5\n" + FORCED.replace("amplitude = 0.5\nfrequency = 1.0", 'constant = "f"')
BEATING = PUSHED + "".join(f'[[forces]]\non = "u2"\namplitude = 1.0\nfrequency = {frequency}\n' for frequency in (1.0, 1.4142135))

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
    # where there is no catalogue, or none can be
    ("list", ["there is no catalogue {here}/none/saltus/lee2009.sqlite", "--save"]),
    ("list --mu 0.3", ["lee2009-mu0.3.sqlite"]),
    ("list --rho 0.7", ["restitution 0.7 of stop a loses energy; its motion is for saltus run"]),
    ("list --catalogue {here}", ["cannot read {here}: it is a directory, expected the file of a catalogue"]),
    ("check --catalogue none.sqlite", ["there is no catalogue none.sqlite"]),
    ("check --catalogue {catalogue} --json {catalogue}", ["as catalogues are; expected another file"]),
    ("discover --energy 1 --catalogue no/such.sqlite", ["there is no catalogue no/such.sqlite"]),
    ("build --json a --catalogue a", ["--json and --catalogue both go to a:"]),
    ("continue S13+ --save --json a --catalogue a", ["--json and --catalogue both go to a:"]),
    ("continue S11- --save --catalogue {text}", ["not an SQLite file"]),
    ("continue S11- --save --catalogue no/such.sqlite", ["does not exist"]),
    # a part of an id
    ("orbit 87dd6282", ["87dd6282 is a part of an id", "expected --catalogue FILE"]),
    ("continue 87dd6282", ["87dd6282 is a part of an id", "expected --catalogue FILE"]),
    ("run --duration 1 --on 87dd6282", ["87dd6282 is a part of an id", "expected --catalogue FILE"]),
    # parameters
    ("continue S13O00+ --mu -0.1", ["mu, the mass ratio, must be above 0", "-0.1"]),
    ("continue S13O00+ --mu inf", ["mu", "finite"]),
    ("continue S13O00+ --mu nan", ["mu", "'nan'", "a number"]),
    ("continue S13O00+ --mu 1e-300", ["mu", "too small", "1e-300", "1e-25 to 1e+25"]),
    ("continue S13O00+ --sigma 1e300", ["sigma", "too large", "1e+300", "a size from 0 to 1e+25"]),
    ("continue S13O00+ --sigma -1", ["sigma, the coupling stiffness, must be 0 or above", "-1"]),
    ("continue S13O00+ --rho -0.5", ["rho, the restitution, lies in [0, 1]", "-0.5"]),
    ("continue S13O00+ --lam -0.5", ["lam, the damping, must be 0 or above", "-0.5"]),
    # what is not conservative
    ("continue S13O00+ --rho 0.7", ["restitution 0.7", "stop a", "saltus run"]),
    ("continue S13O00+ --lam 0.01", ["damping", "0.01"]),
    ("continue S13O00+ --scene {damped}", ["damping", "0.1"]),
    # energy ranges
    ("continue S13O00+ --energy 2:1", ["'2:1'", "LO:HI with 0 < LO < HI"]),
    ("continue S13O00+ --energy nan:2", ["'nan:2'", "LO:HI"]),
    ("orbit S13O00+ --energy -1", ["'-1'", "above 0"]),
    ("orbit S13O00+ --alpha nan", ["'nan'", "a number"]),
    ("orbit S13O00+", ["--energy", "--alpha"]),
    # files
    ("continue S13O00+ --json missing/a.json", ["cannot write", "directory", "does not exist"]),
    ("continue S13O00+ --csv {here}", ["cannot write", "is a directory"]),
    ("continue S13O00+ --plot {here}/a", ["no figure format", "png, pdf or svg"]),
    ("continue S13O00+ --plot {here}/a.pgn", ["unknown figure format 'pgn'", "nearest: png"]),
    ("continue S13O00+ --plot -", ["no figure format of '-'"]),
    ("continue S13O00+ --plot missing/a.png", ["cannot write missing/a.png: the directory missing does not exist"]),
    ("continue S13O00+ --json - --csv -", ["--json", "--csv", "standard output"]),
    ("continue S13O00+ --json {here}/a --csv {here}/a", ["--json", "--csv", "both"]),
    # scenes
    ("continue S13O00+ --scene {unknown}", ["unknown key 'stifness'", "nearest known: stiffness"]),
    ("continue S13O00+ --scene=", ["scene", "it is a directory"]),
    ("continue S13O00+ --scene {text}", ["cannot read scene", "as TOML", "line 1", "column"]),
    ("continue S13O00+ --scene {indefinite}", ["mass must be positive definite"]),
    ("continue --scene {softening} --from mode:1 --energy 0.5:1", ["no turning point", "energy h = 0.25", "expected lower energies"]),
    ("continue --scene {softening} --from mode:1 --energy 0.25:1", ["ends at the equilibrium", "energy h = 0.25", "received 0.25, exp"]),
    ("continue --scene {curl} --from mode:1", ["no potential", "on x changes with y unlike that on y with x", "loads and --in NAME\n"]),
    ("continue --scene {outside} --from mode:1 --energy 0.1:1", ["lies beyond stop a, whose gap coordinate goes from 0.3 to 0.5"]),
    ("continue S13O00+ --scene {asymmetric}", ["mass must be symmetric", "(1, 2) is 2 and (2, 1) is 0.5"]),
    ("continue S13O00+ --scene {deep}", ["cannot read scene", "nested too deeply"]),
    ("continue S13O00+ --scene {here}", ["cannot read scene", "it is a directory"]),
    ("continue S13O00+ --scene {here}/gone.toml", ["gone.toml", "does not exist"]),
    ("continue S13O00+ --scene {one_sided} --mu 0.1", ["mu", "matrices"]),
    # origin ends without odd symmetry
    ("continue S13O00+ --scene {uneven}", ["S13O00+ starts at the origin", "equal gaps", "from -1 to 0.5;", "the id of a", "saltus build"]),
    ("continue S13O00+ --scene {bent}", ["S13O00+ has impacts, and this system has no stops"]),
    ("continue S13+ --scene {bent}", ["S13+ starts at the origin", "force is not odd; expected saltus continue --from mode:K"]),
    ("continue rest-rest::dd737b71 --scene {bent}", ["with smooth forces", "from the origin", "--catalogue FILE", "--from FILE:EVENT,ID"]),
    ("continue periodic:++:dd737b71 --scene {bent}", ["with smooth forces", "from the origin", "--catalogue FILE", "--from FILE:EVENT,ID"]),
    ("continue rest-rest:+:dc2855cb --scene {one_sided}", ["two degrees of freedom", "this system has 1", "--catalogue FILE"]),
    # loads that a command does not use
    ("continue S13O00+ --scene {forced}", ["saltus continue", "without loads", "[[forces]]", "saltus run"]),
    ("orbit S13O00+ --energy 1 --scene {forced}", ["saltus orbit", "[[forces]]"]),
    ("discover --energy 1 --scene {forced}", ["saltus discover", "[[forces]]"]),
    ("section --energy 1 --scene {forced}", ["saltus section", "[[forces]]"]),
    ("impulsive --energy 1:2 --scene {forced}", ["saltus impulsive", "[[forces]]"]),
    ("build --scene {forced} --catalogue {here}/a.sqlite", ["saltus build", "[[forces]]"]),
    ("list --scene {forced}", ["there is no catalogue", "forced.sqlite"]),
    ("tree S13O00+ --scene {forced}", ["there is no catalogue", "forced.sqlite"]),
    ("export fep --plot {here}/a.png --scene {forced}", ["saltus export", "[[forces]]"]),
    ("export points --csv {here}/a.csv --scene {forced}", ["there is no catalogue", "forced.sqlite"]),
    ("section --energy 1 --scene {shaken}", ["saltus section", "[ground]"]),
    ("run --scene {flat} --state 0,1 --duration 1", ["the potential of the spring of all coordinates has no coordinate: pi"]),
    ("run --scene {marked} --state 0,1,0,0 --duration 1", ["parameter 'x\u0303' cannot be named", "letters, digits and _"]),
    ("continue S13O00+ --scene {extreme}", ["entry (1, 1) of mass", "too small", "1e-300"]),
    ("continue S13O00+ --scene {twice}", ["coordinates have different names", "('x', 'x')"]),
    # discovery
    ("discover", ["--energy"]),
    ("discover --energy 0", ["--energy", "'0'", "above 0"]),
    ("discover --energy nan", ["--energy", "'nan'", "a number"]),
    ("discover --energy 1 --max-quarter-period -1", ["--max-quarter-period", "'-1'", "above 0"]),
    ("discover --energy 1 --max-impacts 200000", ["200000", "from 0 to 10000, or no bound"]),
    ("discover --energy 1 --max-impacts 100000000000000000000000", ["--max-impacts", "up to 1e15"]),
    ("build --max-impacts 200000 --catalogue {here}/a.sqlite", ["200000", "from 0 to 10000"]),
    ("discover --energy 1 --max-impacts 2.5", ["--max-impacts", "'2.5'", "integer"]),
    ("discover --energy 1 --ends rest-sop", ["'rest-sop'", "nearest: rest-stop"]),
    ("discover --energy 1 --ends origin-origin,", ["unknown ends ''"]),
    ("discover --energy 1 --rho 0.7", ["restitution 0.7", "stop a"]),
    ("discover --energy 1 --scene {one_sided}", ["two degrees of freedom", "this system has 1"]),
    ("discover --energy 1 --ends origin-origin --scene {uneven}", ["origin-origin", "odd symmetry", "rest-rest"]),
    # words of the command line
    ("contnue S13O00+", ["'contnue'", "nearest: continue"]),
    ("continue", ["received neither", "expected NAME", "--from mode:1"]),
    ("continue S13O00+ more", ["unexpected argument 'more'"]),
    ("continue S13O00+ --points 0", ["--points", "'0'", "above 0"]),
    ("continue S13O00+ --direction upp", ["--direction", "'upp'", "nearest: up"]),
    ("continue S13O00+ --frequency indexx", ["--frequency", "nearest: index"]),
    ("continue S13O00+ --stop-at sn", ["--stop-at", "'sn'", "nearest: SN"]),
    ("continue S13O00+ --model=3", ["--model", "ignored explicit argument '3'"]),
    ("--versoin", ["--versoin", "nearest: --version"]),
    # where a family begins
    ("continue S13+ --from mode:1", ["received S13+ and --from mode:1"]),
    ("continue --from mode:3", ["the system has 2 modes", "expected one of mode:1, mode:2"]),
    ("continue --from mode:0", ["saltus: 'mode:0' is no linear mode; expected mode:1, mode:2, ..\n"]),
    ("continue mode:1", ["expected a label or a family id (linear modes are for --from; in Python see saltus.linear_modes)\n"]),
    ("continue --from mode:1 --sigma 0", ["mode 1 is a rigid-body mode, which does not come to rest", "expected mode:2"]),
    ("continue --from mode:1,covr=2", ["unexpected 'covr=2'", "mode:K,cover=N"]),
    ("continue --from mode:1,cover=12", ["cover = 12: expected an integer, 1 to 11"]),
    ("continue --from mode:1,cover=0", ["cover = 0: expected an integer, 1 to 11"]),
    ("continue --from mode:1,cover=100000000000", ["cover = 100000000000: expected an integer, 1 to 11"]),
    ("continue --from mode:1,cover=2,origin-rest:++", ["expected one of mode:1,cover=2,", ", mode:1,cover=2,"]),
    ("continue --from mode:1 --energy 1:1.00000001", ["outside the energy range 1:1.00000001"]),
    ("continue --from mode:1,origin-origin:+-", ["no family origin-origin:+- begins at mode:1", "mode:1,cover=1,origin-stop+:"]),
    ("continue --from mode:1 --energy 1:2", ["touches the stops at h = 0.1185078106", "outside the energy range 1:2"]),
    ("continue --from mode:1 --rho 0.7", ["need a conservative system: restitution 0.7"]),
    ("continue --from mode:1 --catalogue c.sqlite", ["--from looks nothing up", "--save"]),
    ("continue --from mode1", ["no file 'mode1'", "expected mode:K, or a JSON file"]),
    ("continue --from=", ["no file ''", "expected mode:K, or a JSON file"]),
    ("continue --from {family}:PD7", ["family.json:PD7: no event 'PD7' on this branch; it has"]),
    (
        "continue --from rest --in sigma",
        ["--from rest is the response to periodic loads", "has no load", "or a NAME or --from mode:K, with --keep"],
    ),
    ("continue S13+ --scene three_mass_chain", ["starts at the origin", "saltus continue --from mode:K and saltus build"]),
    (
        "continue --from mode:3 --scene gear_pair --set k=2",
        ["gear_pair has no parameter k: its matrices are numbers", "[parameters] or a model"],
    ),
    ("continue S13+ --json=", ["--json: the name of the file is empty"]),
    ("continue --from {file}", ["file is not JSON"]),
    ("continue --from {taken}", ["cannot read", "taken"]),
    # build
    ("build --energy 5:1 --catalogue a.sqlite", ["'5:1'", "LO < HI"]),
    ("build --workers 0 --catalogue a.sqlite", ["'0'", "from 1 to 1024"]),
    ("build --workers 99999999999 --catalogue a.sqlite", ["'99999999999'", "from 1 to 1024"]),
    ("build --catalogue none/a.sqlite", ["none", "does not exist"]),
    ("build --rho 0.7 --catalogue a.sqlite", ["restitution 0.7"]),
    (
        "build --workers 2 --dask tcp://127.0.0.1:8786 --catalogue a.sqlite",
        ["--workers counts processes", "--dask tcp://127.0.0.1:8786", "expected one of them"],
    ),
    # sections
    ("section", ["--energy H", "--panels"]),
    ("section --energy 0", ["'0'", "above 0"]),
    ("section --energy 1,2", ["several energies", "--panels"]),
    ("section --energy 2:1 --panels", ["'2:1'", "LO < HI"]),
    ("section --energy 2,1 --panels", ["'2,1'", "rising"]),
    ("section --energy 1 --colour rotatoin", ["'rotatoin'", "nearest: rotation"]),
    ("section --energy 1 --colour rotation --rho 0.7", ["restitution 0.7", "--colour lyapunov"]),
    (
        "continue --scene damped_impact_oscillator --from rest --in w,A --range 0.5:1 --keep A=0.02*w²",
        ["--keep", "0.02*w²", "not an expression at character 7"],
    ),
    *(
        (f"continue --scene damped_impact_oscillator --from rest --in w,A --range 0.5:1 --keep A={text}", ["--keep", text, name])
        for text, name in (("sin(sin)", "sin"), ("sin+sin(w)", "sin"), ("sqrt(sqrt)", "sqrt"))
    ),
    ("section --energy 1 --colour energy", ["--colour energy", "keeps its energy", "lyapunov or rotation"]),
    ("section --energy 1 --names 3", ["--names needs --plot FILE and --catalogue FILE"]),
    ("section --energy 1 --about 0,0", ["--about", "--colour rotation"]),
    ("section --energy 0.06 --start 0", ["'0'", "X,Y"]),
    ("section --energy 0.06 --start 0,inf", ["'inf'", "a finite number"]),
    ("section --energy 0.06 --start -0.2,9", ["bounding curve", "h = 0.06", "[-0.2, 9.0]"]),
    ("section --energy 0.06 --orbits 0", ["--orbits", "'0'", "above 0"]),
    ("section --energy 0.06 --json a.npz --npz a.npz", ["--json and --npz", "a.npz"]),
    ("section --energy 0.06 --catalogue none.sqlite", ["none.sqlite"]),
    ("section --energy 0.06 --scene {one_sided}", ["two degrees of freedom", "this system has 1"]),
    ("section --energy 0.06 --scene {two}", ["primary", "LO = u1 or u2"]),
    ("section --energy 0.01 --scene {lo}", ["no motion with energy 0.01 reaches", "above 0.045"]),
    ("section --panels --scene {lo}", ["the scene gives no [sections] energies for panels"]),
    (f"section --panels --energy {','.join(map(str, range(1, 28)))}", ["--energy gives 27 energies", "26 at most"]),
    ("section --panels --scene {falling}", ["[sections]", "rising energies above 0"]),
    ("section --panels --scene {cited}", ["[sections]", "cited = [3.0]", "some of the energies"]),
    ("section --energy 0.06 --mu 0.2 --catalogue {catalogue}", ["mu"]),
    # impulsive orbits
    ("impulsive", ["--energy"]),
    ("impulsive --energy -1:1", ["'-1:1'", "0 < LO"]),
    ("impulsive --energy 1:2 --rho 0.7", ["restitution 0.7"]),
    ("impulsive --energy 1:2 --max-quarter-perid 3", ["--max-quarter-perid", "nearest: --max-quarter-period"]),
    # one motion
    ("run --duration 5", ["where does the motion start", "--on", "--impulsive", "--state"]),
    ("run --impulsive --duration 5", ["--energy H"]),
    ("run --impulsive --energy 1", ["--duration is required", "sampled load"]),
    ("run --energy 1 --impulse 2 --duration 5", ["--energy 1", "--on NAME or --impulsive"]),
    ("run --impulse 2 --state 0,0,0,1 --duration 5", ["--state and --impulse", "one of them"]),
    ("run --impulsive --state 0,0,0,1 --energy 2 --duration 5", ["--state and --impulsive"]),
    ("run --state 0,0,1 --duration 5", ["3 numbers, expected 4", "u1,u2,u1',u2'"]),
    ("run --state 0,0,a,1 --duration 5", ["'0,0,a,1'", "finite numbers"]),
    ("run --state 1.5,0,0,1 --duration 5", ["beyond stop a", "1.5", "-1 to 1"]),
    ("run --impulse nan --duration 5", ["'nan'", "a finite number"]),
    ("run --impulse 1 --duration -5", ["'-5'", "above 0"]),
    ("run --impulse 1 --duration 5 --samples 1", ["--samples 1", "2 at least"]),
    ("run --impulse 1 --duration 5 --caption words", ["--caption", "--plot FILE"]),
    ("run --impulse 1 --duration 5 --npz -", ["npz", "standard output"]),
    ("run --impulse 1 --duration 5 --mat {here}/a --npz {here}/a", ["--npz", "--mat", "both"]),
    ("run --impulse 1 --duration 5 --catalogue missing.sqlite", ["missing.sqlite"]),
    ("run --impulse 1 --durration 5", ["--durration", "nearest: --duration"]),
    ("run --on S13O00+ --duration 5", ["an orbit of S13O00+ needs", "--energy H", "@alpha=A"]),
    ("run --on S13O00+@h=2 --energy 1 --duration 5", ["h = 2", "--energy says 1"]),
    ("run --on S13O00+ --energy 0.01 --duration 5", ["S13O00+", "0.01", "0.1185078"]),
    ("run --on S13O00+ --impulsive --duration 5", ["S13O00+ has no impulsive orbit"]),
    ("run --on S11O00- --energy 0.08 --duration 5", ["2 orbits of S11O00-", "@h=0.08,alpha="]),
    ("run --scene {unmarked} --impulse 1 --duration 5", ["LO under [coordinates]", "--state"]),
    ("run --scene {unmarked} --state 0,0,0,0,1,0 --duration 5 --locked", ["no coordinate is marked as NES"]),
    ("run --scene {unmarked} --state 0,0,0,0,1,0 --duration 5 --mu 0.2", ["mu", "matrices"]),
    # sweeps
    ("continue S13O00+ --harmonics 0 --csv a.csv", ["--harmonics", "'0'", "above 0"]),
    ("continue S13O00+ --harmonics many --csv a.csv", ["--harmonics", "'many'", "integer above 0"]),
    ("continue S13O00+ --harmonics 3", ["--harmonics 3", "no file", "--csv", "--plot"]),
    ("continue --scene absorber --from rest --in w --range 0.7:0.8 --harmonics 3", ["--harmonics 3", "no file", "--csv", "--plot"]),
    ("sweep --scene impact_oscillator --range 0.1:0.2", ["--in NAME is required"]),
    ("sweep --scene impact_oscillator --in w", ["--range LO:HI is required"]),
    ("sweep --scene impact_oscillator --in w --range 2:1", ["'2:1'", "LO:HI with LO < HI"]),
    ("sweep --scene impact_oscillator --in w --range 1:2 --points 0", ["--points", "'0'", "above 0"]),
    ("sweep --scene impact_oscillator --in w --range 1:2 --points 1", ["--points 1: expected 2 at least"]),
    ("sweep --scene impact_oscillator --in w --range 1:2 --record 0", ["--record", "'0'", "above 0"]),
    ("sweep --scene impact_oscillator --in w --range 1:2 --transient -1", ["--transient", "'-1'", "0 or more"]),
    ("sweep --scene absorber --in sgma --range 0.1:0.2", ["'sgma'", "nearest: sigma"]),
    ("sweep --scene impact_oscillator --in r --range 0.5:1.5", ["restitution", "[0, 1]", "r = 1."]),
    ("sweep --scene impact_oscillator --in w --range -1:2", ["frequency", "above 0", "w = -1"]),
    ("sweep --scene absorber --in w --range 1:2 --y max:u3", ["--y: unknown measure 'max:u3'", "nearest: max:u"]),
    ("sweep --scene impact_oscillator --in w --range 1:2 --start 1,2,3", ["3 numbers, expected 2", "x,x'"]),
    ("sweep --scene impact_oscillator --in w --range 1:2 --start 2,0", ["beyond stop a", "its gap is 2"]),
    ("sweep --scene impact_oscillator --in w --range 1:2 --workers 2 --dask tcp://x", ["--workers", "--dask", "one of them"]),
    ("sweep --in mu --range 0.1:0.2", ["no load is periodic", "amplitude and frequency"]),
    ("sweep --scene three_storey_building --in w --range 0.1:0.2", ["a record has none", "harmonic and constant loads"]),
    ("sweep --scene {constant} --in f --range 0.1:0.2", ["no load is periodic"]),
    ("sweep --scene {unused} --in k --range 0.1:0.2", ["parameter k is used nowhere"]),
    ("sweep --scene {beating} --in f --range 0.1:0.2", ["incommensurate"]),
    # basins
    ("basin --scene absorber --x u1:-1:1", ["a basin needs two state coordinates to vary", "--x u1 alone", "expected --y too", "u1'"]),
    ("basin --scene absorber --y u2'", ["a basin needs two state coordinates to vary", "--y u2' alone", "expected --x too", "u2"]),
    ("basin --scene absorber --x u1 --y u1:0:1", ["a basin needs two state coordinates to vary", "received u1 twice"]),
    ("basin --scene absorber --x u3 --y u1", ["--x u3: no such coordinate", "u1, u2, u1', u2'", "nearest: u"]),
    ("basin --scene absorber --x u1:2:1 --y u2", ["--x", "'u1:2:1'", "NAME:LO:HI with LO < HI"]),
    ("basin --scene absorber --x u1:1 --y u2", ["--x", "'u1:1'", "NAME:LO:HI"]),
    ("basin --scene absorber --fix v=1", ["--fix v: no such coordinate", "u1, u2, u1', u2'"]),
    ("basin --scene absorber --fix u1=1", ["u1 varies over the grid"]),
    ("basin --scene absorber --fix u2=1 --fix u2=2", ["--fix u2 is given twice"]),
    ("basin --scene absorber --fix u2", ["--fix", "'u2'", "NAME=VALUE"]),
    ("basin --scene absorber --fix u2=9 --x u1:-1:1 --y u1':-1:1", ["every start over u1 and u1' is beyond a stop"]),
    ("basin --scene absorber --grid 20", ["--grid", "'20'", "NXxNY", "200x200"]),
    ("basin --scene absorber --grid 1x20", ["--grid", "'1x20'", "integers above 1"]),
    ("basin --scene absorber --grid 10000x10000", ["the grid has 100000000 starts", "expected 10000000 at most"]),
    ("basin --scene absorber --phase pi", ["--phase", "'pi'", "finite number"]),
    ("basin --scene absorber --periods 0", ["--periods", "'0'", "above 0"]),
    ("basin --scene absorber --from none.json", ["none.json"]),
    ("basin --scene absorber --workers 2 --dask tcp://x", ["--workers", "--dask", "one of them"]),
    ("basin", ["no load is periodic", "amplitude and frequency"]),
    # the gallery
    ("gallery papr --out new", ["unknown gallery 'papr'", "nearest: paper"]),
    ("gallery --out new", ["required: NAME"]),
    ("gallery paper", ["required: --out"]),
    ("gallery paper --out new --figure fig15", ["unknown figure 'fig15'", "fig10", "nearest: fig"]),
    ("gallery paper --out new --format gif", ["'gif'", "png, pdf, svg"]),
    ("gallery paper --out {file}", ["--out", "it is a file", "expected a folder"]),
    ("gallery paper --out {file}/figures", ["cannot make the folder"]),
    ("gallery paper --out {taken}", ["fig14.png", "it is a directory"]),
    ("gallery paper --out new --catalogue none.sqlite", ["none.sqlite"]),
    ("gallery paper --out new --catalogue {file}", ["file"]),
    # figures of many families
    ("export fap --plot a.png --branches {family}", ["'fap'", "fep"]),
    ("export fep --plot a.png --branches {family} --mu 0.2", ["family.json belongs to another system", "mu is 0.1, not 0.2"]),
    ("export fep --plot a.png --branches {chain}", ["belongs to another system than the scene lee2009", "--scene FILE"]),
    ("export fep --branches {family}", ["--plot", "--csv"]),
    ("export fep --plot a.png", ["there is no catalogue", "saltus continue NAME --save"]),
    ("export fep --plot a.png --rho 0.7", ["restitution 0.7", "conservative", "saltus run"]),
    ("export fep --plot a.png --branches {family} --data b.npz", ["one of"]),
    ("export fep --plot a.png --branches none.json", ["none.json", "no such file"]),
    ("export fep --plot a.png --data none.csv", ["none.csv", "no such file"]),
    ("export fep --plot a.png --data {family}", ["family.json is not a readable file of figure data"]),
    ("export fep --plot a.png --data {family} --regimes", ["--regimes", "without --data"]),
    ("export fep --plot a.png --branches {family} --inset 3:1", ["3:1", "LO:HI"]),
    ("export velocities --plot a.png --branches {family} --inset 1:3", ["fep"]),
    ("export fep --plot a.png --data {family} --label U*", ["--label", "without --data"]),
    ("export fep --plot a.png --branches {family} --label U8* --stable", ["fits --label U8* --stable"]),
    ("export velocities --plot a.png --branches {family} --energy 0", ["above 0"]),
    ("export fep --plot a.png --branches {family} --labl U8", ["nearest: --label"]),
    ("export fep --plot a.png --branches {family} --clearance 0", ["above 0"]),
    ("export fep --plot a.png --branches {family} --energy 1e7:1e8", ["nothing to draw"]),
    ("export fep --csv a.csv --branches {family} --names 3", ["--names", "--plot FILE"]),
    ("export fep --npz a.npz --branches {family} --inset 1:3", ["--inset", "--plot FILE"]),
]

OF_A_CATALOGUE = [
    # its system, its place
    ("discover --energy 1 --mu 0.2", ["belongs to another system: there mu is 0.1, not 0.2"]),
    ("impulsive --energy 1:2 --mu 0.2", ["belongs to another system: there mu is 0.1, not 0.2"]),
    ("list --json {catalogue}", ["as catalogues are; expected another file"]),
    ("build --json {catalogue}", ["as catalogues are; expected another file"]),
    ("continue S13+ --csv {catalogue}", ["as catalogues are; expected another file"]),
    ("export points --csv {catalogue}", ["as catalogues are; expected another file"]),
    # families by their names
    ("show S99O00+", ["nearest that exist"]),
    ("show Q", ["character 1"]),
    ("tree U8353-", ["nearest that exist"]),
    ("list --ends rest-rest", ["expected one of origin-origin"]),
    ("list --label Ux", ["character 2"]),
    ("list --impacts 5:1", ["0 <= LO <= HI"]),
    ("tree S13+ --depth 0", ["above 0"]),
    ("show S13+ --plot orbit.png --json orbit.png", ["--json and --plot both go to orbit.png"]),
    ("show L11+ --plot mode.png", ["linear mode"]),
    ("continue L11+", ["linear mode"]),
    ("orbit L11+ --energy 0.1", ["linear mode"]),
    ("continue S13+ --energy 50:60", ["outside the energy range 50:60"]),
    ("orbit S13+ --energy 50", ["no orbit of S13+ has h = 50", "; end GR at h = "]),
    ("continue S13+ --mu 0.2", ["mu is 0.1, not 0.2"]),
    ("continue S13+ --mu 0.2 --save", ["belongs to another system: there mu is 0.1, not 0.2"]),
    ("build --mu 0.2", ["belongs to another system: there mu is 0.1, not 0.2"]),
    # exports
    ("export grph --json g.json", ["nearest: graph"]),
    ("export graph --grapml g.graphml", ["nearest: --graphml"]),
    ("export points", ["missing: --json or --csv or --npz or --mat"]),
    ("export points --csv p.csv --columns h,alfa", ["unknown column 'alfa' of points; nearest: alpha"]),
    ("export points --csv p.csv --columns h,alpha,h", ["column 'h' is given 2 times; expected each column once"]),
    ("export graph", ["missing: --json or --graphml or --dot (see saltus export graph --help)\n"]),
    ("export fep --csv data.txt", ["expected a file ending in .csv"]),
    ("export orbits L11+ --csv o.csv", ["L11+ is a linear mode"]),
    ("export fep --mu 0.2 --plot f.png", ["belongs to another system: there mu is 0.1, not 0.2"]),
    ("export orbits --csv o.csv", ["orbits need names such as S13O00+@h=1", "--energy H"]),
    ("export orbits S13+ --csv o.csv", ["an orbit of S13+ needs"]),
    ("export orbits S13+@h=1 --energy 2 --csv o.csv", ["names and --energy both choose orbits"]),
    ("export orbits S13+@h=1 --label U8* --csv o.csv", ["names and --label both choose orbits"]),
    ("export graph --json g.json --columns h", ["unknown option --columns of saltus export graph"]),
    ("export points --csv no/such/p.csv", ["does not exist"]),
    ("export points --csv p.csv --label U8*", ["fits --label U8*; saltus list"]),
    ("export points S13+ --csv p.csv --ends origin-origin", ["fits S13+ --ends origin-origin; saltus list"]),
    ("export points L11+ --npz p.npz", ["fits L11+; saltus list"]),
    ("export orbits --csv o.csv --energy 90", ["fits --energy 90.0; saltus list"]),
]
"""Of commands that are given the catalogue of the tests."""


@pytest.fixture(scope="module")
def places(tmp_path_factory, catalogue):
    """Files and directories that the cases name."""
    texts = {
        "unknown": ONE_SIDED.replace("stiffness", "stifness"),
        "text": "h,alpha\n",
        "deep": f"deep = {5000 * '['}{5000 * ']'}",
        "one_sided": ONE_SIDED,
        "indefinite": UNEVEN.replace("mass = [[1.0, 0.0], [0.0, 1.0]]", "mass = [[1.0, 2.0], [2.0, 1.0]]"),
        "asymmetric": UNEVEN.replace("mass = [[1.0, 0.0], [0.0, 1.0]]", "mass = [[1.0, 2.0], [0.5, 1.0]]"),
        "softening": SOFTENING,
        "curl": CURL,
        "bent": CURL.replace('force = "y**3"', "polynomial = [0.0, 0.5]") + ONE_SIDED[ONE_SIDED.index("[bounds]") :],
        "flat": SOFTENING.replace('on = "x"\nstiffness = -1.0\npower = 3', 'potential = "pi"'),
        "marked": PUSHED.replace("f = 0.5", '"x\u0303" = 0.5').replace('"f"', '"x\u0303"'),
        "outside": SOFTENING + "[[stops]]\nc = [1.0]\nlower = 0.3\nupper = 0.5\n",
        "damped": DAMPED,
        "uneven": UNEVEN,
        "forced": FORCED,
        "constant": PUSHED,
        "unused": PUSHED.replace("f = 0.5", "f = 0.5\nk = 1.0"),
        "beating": BEATING,
        "shaken": UNEVEN + "[ground]\namplitude = 1.0\nfrequency = 2.0\n",
        "extreme": UNEVEN.replace("[[1.0, 0.0]", "[[1e-300, 0.0]", 1),
        "twice": UNEVEN + '[coordinates]\nnames = ["x", "x"]\n',
        "two": TWO,
        "lo": TWO + MARKED,
        "falling": TWO + MARKED + "[sections]\nenergies = [2.0, 1.0]\n",
        "cited": TWO + MARKED + "[sections]\nenergies = [1.0, 2.0]\ncited = [3.0]\n",
        "unmarked": BUILDING.replace('LO = ["floor", "roof"]\nNES = ["sink"]\n', ""),
    }
    folder = tmp_path_factory.mktemp("input")
    paths = {name: folder / f"{name}.toml" for name in texts} | {name: folder / f"{name}.json" for name in ("family", "chain")}
    paths["file"] = folder / "file"
    for name, text in {**texts, "file": "kept"}.items():
        paths[name].write_text(text)
    real()[0].save(paths["family"])
    begun = saltus.families_at(saltus.linear_modes(saltus.load_scene("three_mass_chain").system)[0], 1, 1, points=3)[0]
    begun.branch.save(paths["chain"])
    (folder / "taken" / "fig14.png").mkdir(parents=True)
    return {**paths, "input": folder, "taken": folder / "taken", "catalogue": catalogue}


CALLS = [*CASES, *((f"{words} --catalogue {{catalogue}}", said) for words, said in OF_A_CATALOGUE)]


@pytest.mark.parametrize(("words", "expected"), CALLS, ids=[words for words, _ in CALLS])
def test_one_line_and_exit_code_2(capsys, places, tmp_path, monkeypatch, words, expected):
    """Oracle: the input; each message holds what was received and what was expected. No file is made or changed."""

    def files():
        return {path: path.is_file() and path.read_bytes() for path in [*places["input"].rglob("*"), places["catalogue"]]}

    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("XDG_DATA_HOME", str(tmp_path / "none"))
    before = files()
    named = {"here": tmp_path, **places}
    refused(run(capsys, *words.format_map(named).split()), *(part.format_map(named) if "{here}" in part else part for part in expected))
    assert not list(tmp_path.iterdir()) and files() == before


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


@pytest.mark.skipif(not os.path.isdir("/proc/self"), reason="there is no directory that allows files and takes none")
def test_a_directory_that_takes_no_file_is_found_before_the_work(capsys):
    """Oracle: exit code 2, and nothing of the table."""
    refused(run(capsys, "continue", "S13O00+", "--json", "/proc/branch.json"), "cannot write /proc/branch.json")


def test_a_data_folder_that_cannot_be_made(capsys, tmp_path, monkeypatch):
    """Oracle: a file where the user's data folder would be."""
    (tmp_path / "file").write_text("kept")
    monkeypatch.setenv("XDG_DATA_HOME", str(tmp_path / "file"))
    refused(run(capsys, "continue", "S13+", "--save"), f"cannot make the directory {tmp_path}/file/saltus")


@pytest.mark.parametrize(
    ("package", "words"),
    [("distributed", "build --dask tcp://127.0.0.1:8786 --catalogue a.sqlite"), ("pyarrow", "study a.toml --format parquet")],
)
def test_a_package_that_is_not_installed(capsys, tmp_path, monkeypatch, package, words):
    """Oracle: Python's own mark of a module that cannot be imported; the package's extra of setup.cfg."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setitem(sys.modules, package, None)
    monkeypatch.setattr("importlib.util.find_spec", lambda name: None)
    (tmp_path / "a.toml").write_text('design = "grid"\n[vary.rho]\nvalues = [0.5]\n[fixed]\nenergy = 1.0\n')
    extra = {"distributed": "dask", "pyarrow": "parquet"}[package]
    refused(run(capsys, *words.split()), f"needs the package {package}, which is not installed", f"pip install 'saltus[{extra}]'")
    assert [path.name for path in tmp_path.iterdir()] == ["a.toml"]
