"""Methods for the tests of the speed-error benchmark: plain, failing, endless, absent, interrupted and wrong ones."""

import time

from benchmarks.speed_error.methods import Answer, OrbitAnswer, Work


class Plain:
    """Answers at once, with the energy off by the part `setting` of it."""

    name, setting = "plain", "off by"

    def missing(self):
        return None

    def does(self, task):
        return task.name == "S13O00+"

    def settings(self, tolerances):
        return tolerances

    def prepare(self, task, setting):
        return Work(lambda: Answer(orbits=(OrbitAnswer(task.alpha, float(task.exact().h) * (1.0 + setting)),)))


class Failing(Plain):
    name = "failing"

    def prepare(self, task, setting):
        def fail():
            raise ArithmeticError("it does not\nconverge")

        return Work(fail) if setting > 1e-3 else super().prepare(task, setting)


class Endless(Plain):
    name = "endless"

    def prepare(self, task, setting):
        return Work(lambda: time.sleep(600.0)) if setting < 1e-3 else super().prepare(task, setting)


class Absent(Plain):
    name = "absent"

    def missing(self):
        return "the program absent is not installed"

    def prepare(self, task, setting):
        raise AssertionError("a missing method was used")


class Interrupted(Plain):
    name = "interrupted"

    def settings(self, tolerances):
        raise KeyboardInterrupt


class Astray(Plain):
    """Its answer is so wrong that there is no orbit near it."""

    name = "astray"

    def does(self, task):
        return task.name == "U8353-"

    def prepare(self, task, setting):
        y = task.unknowns()
        return Work(lambda: Answer(orbits=(OrbitAnswer(task.alpha, 1.0, task.start_velocities(y), None, None, 30.0 * y),)))
