"""Systems under periodic loads."""

OSCILLATOR = {
    "parameters": {"A": 1.0, "w": 2.8, "d": -0.05, "r": 0.8},
    "system": {"mass": [[1.0]], "stiffness": [[1.0]], "stops": [{"c": [1.0], "upper": "d", "restitution": "r"}]},
    "forces": [{"load": [1.0], "amplitude": "A", "harmonic": 1}],
}
PAIR = {
    "parameters": {"A": 0.4, "w": 1.3, "d": 1.0, "r": 0.7, "b": 0.05},
    "system": {
        "mass": [[1.0, 0.0], [0.0, 0.2]], "damping": [[0.05, -0.02], [-0.02, 0.03]], "stiffness": [[1.5, -0.4], [-0.4, 0.5]],
        "stops": [{"c": [1.0, -1.0], "lower": "-d", "upper": "d", "restitution": "r"}],
    },
    "forces": [{"load": [1.0, 0.3], "amplitude": "A", "harmonic": 1}, {"load": [0.0, 1.0], "constant": "b"}],
}  # fmt: skip
ODD = {
    **PAIR,
    "parameters": {"A": 0.4, "w": 1.3, "d": 1.0, "r": 0.7},
    "forces": [{"load": [1.0, 0.3], "amplitude": "A", "harmonic": 1}, {"load": [0.2, 0.1], "amplitude": "A/3", "harmonic": 3}],
}
AUTONOMOUS = {
    "parameters": {"f": 1.0, "d": 0.3, "r": 0.6},
    "system": {"mass": [[1.0]], "damping": [[-0.1]], "stiffness": [[1.0]], "stops": [{"c": [1.0], "upper": "d", "restitution": "r"}]},
    "forces": [{"load": [1.0], "constant": "f"}],
}
HELD = {
    "parameters": {"A": 0.9, "w": 1.1, "d": 0.2, "g": 0.7},
    "system": {
        "mass": [[1.0, 0.0], [0.0, 0.4]], "damping": [[0.1, 0.0], [0.0, 0.05]], "stiffness": [[1.0, -0.3], [-0.3, 0.8]],
        "stops": [{"c": [1.0, 0.0], "upper": "d", "restitution": 0.0}, {"c": [0.0, 1.0], "upper": 0.9, "lower": "-g", "restitution": 0.6}],
    },
    "forces": [{"load": [1.0, 0.3], "amplitude": "A", "harmonic": 1}],
}  # fmt: skip

FLOATING = {
    "parameters": {"A": 0.8, "w": 1.7, "d": 0.4, "g": 0.3},
    "system": {
        "mass": [[1.0, 0.0], [0.0, 0.5]], "damping": [[0.02, -0.02], [-0.02, 3.0]], "stiffness": [[1.0, -1.0], [-1.0, 1.0]],
        "stops": [{"c": [1.0, -1.0], "lower": "-d", "upper": "d", "restitution": 0.5}],
    },
    "forces": [{"load": [1.0, 0.0], "amplitude": "A", "harmonic": 1}, {"load": [0.2, 0.1], "constant": "g"}],
}  # fmt: skip
FREE = {**FLOATING, "system": {**FLOATING["system"], "damping": [[0.0, 0.0], [0.0, 0.0]]}}

STIFF = {
    **PAIR,
    "parameters": {"A": 0.4, "w": 1.3, "d": 1.0, "r": 0.7, "b": 0.05, "m": 0.2, "k": 0.4, "c": 0.02},
    "system": {
        **PAIR["system"], "mass": [[1.0, 0.0], [0.0, "m"]], "damping": [["c + 0.03", "-c"], ["-c", "c*(1 + m)"]],
        "stiffness": [["1.1 + k", "-k"], ["-k", "k + m/2"]],
    },
}  # fmt: skip
"""Masses, dampers and springs are parameters."""
HEAVY = {**STIFF, "parameters": {**STIFF["parameters"], "c": 40.0}}
"""Overdamped: rates far apart."""
UNDAMPED = {
    "parameters": {"A": 0.4, "w": 1.3, "k": 1.3, "d": 0.1},
    "system": {"mass": [[1.0]], "stiffness": [["k**2"]], "stops": [{"c": [1.0], "upper": "d", "restitution": 0.8}]},
    "forces": [{"load": [1.0], "amplitude": "A", "harmonic": 1}],
}
"""At resonance."""
CLAMPED = {
    **HELD,
    "parameters": {"A": 0.9, "w": 1.1, "d": 0.2, "g": 0.7, "m": 0.4, "k": 0.3},
    "system": {
        **HELD["system"], "mass": [["0.96 + m/10", 0.0], [0.0, "m"]], "damping": [[0.1, 0.0], [0.0, "k/6"]],
        "stiffness": [["0.7 + k", "-k"], ["-k", "0.5 + k"]],
    },
}  # fmt: skip

DUFFING = {
    "parameters": {"F": 0.3, "c": 0.1, "k": 1.0, "a": 0.4, "p": 3.0, "m": 1.0, "w": 1.2, "d": 0.5},
    "system": {
        "mass": [["m"]], "damping": [["c"]], "stiffness": [["k"]], "springs": [{"c": [1.0], "stiffness": "a", "power": "p"}],
        "stops": [{"c": [1.0], "upper": "d", "restitution": 0.7}],
    },
    "forces": [{"load": [1.0], "amplitude": "F", "harmonic": 1, "phase": 0.4}, {"load": [1.0], "constant": 0.1}],
}  # fmt: skip
"""Smooth forces."""
SPRINGS = {
    "parameters": {"F": 0.5, "c": 0.1, "a": 0.5, "b": 2.2, "q": 0.3, "m": 0.2, "w": 1.1},
    "system": {
        "mass": [["m", 0.0], [0.0, 1.0]], "damping": [["c", "-c"], ["-c", "2*c"]], "stiffness": [[0.3, -0.3], [-0.3, 1.3]],
        "springs": [{"between": ["u1", "u2"], "stiffness": "a", "power": "2 + b"}, {"on": "u2", "potential": "q*w**4"}],
        "dampers": [{"on": "u2", "polynomial": [0.0, 0.0, 0.05]}],
        "stops": [{"c": [1.0, -1.0], "lower": -0.6, "upper": 0.6, "restitution": 0.8}],
    },
    "forces": [{"load": [0.0, 1.0], "amplitude": "F", "harmonic": 1}, {"load": [0.1, 0.0], "amplitude": "F", "harmonic": 3}],
}  # fmt: skip
