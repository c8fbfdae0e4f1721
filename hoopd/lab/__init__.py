"""The engineer's interface: model, record, simulate, fit, linearise, design, close the loop.

    import hoopd.lab as lab
    recording = lab.experiment("prbs", duration=20, seed=1)
    fitted = lab.fit(recording)
    law = lab.design("lqg", fitted.model)
    run = lab.feedback(fitted.model, law, disturbance=0.4)

Rules of this package: no mathematics, every function is a few lines over the rooms; what it returns can be looked at
(`.plot()`, a `Picture`) and saved; wrong arguments are a ValueError in one line. Arguments are named as the options
of the command line and in its units: SI, angles in rad, but phases of a design in degrees. Torque, ball and hoop turn
the same way; the ball's angle psi is 0 at the bottom. A lesson with it: `docs/lesson.py`.
"""

from hoopd.lab.campaigns import LearnedModel, learn
from hoopd.lab.comparison import ComparedControllers, compare
from hoopd.lab.controllers import Controller, Design, controller, design
from hoopd.lab.diagnosis import Diagnosed, diagnose
from hoopd.lab.fitting import Fitted, fit
from hoopd.lab.former_names import fit_plant, simulate_plant
from hoopd.lab.healed_loops import LoopVersions, heal
from hoopd.lab.linear import Linear, linearize
from hoopd.lab.loops import ClosedLoop, feedback
from hoopd.lab.maneuvers import PlannedManeuver, trajectory
from hoopd.lab.models import Model, model
from hoopd.lab.pictures import Picture, plot
from hoopd.lab.plant_controllers import DesignedPlant
from hoopd.lab.plant_fits import FittedPlant, PlantRun
from hoopd.lab.plants import plant
from hoopd.lab.recordings import daemon, experiment, load
from hoopd.lab.simulation import Simulation, simulate
from hoopd.recording import Recording, save

__all__ = [
    "ClosedLoop",
    "ComparedControllers",
    "Controller",
    "Design",
    "DesignedPlant",
    "Diagnosed",
    "Fitted",
    "FittedPlant",
    "LearnedModel",
    "Linear",
    "LoopVersions",
    "Model",
    "Picture",
    "PlannedManeuver",
    "PlantRun",
    "Recording",
    "Simulation",
    "compare",
    "controller",
    "daemon",
    "design",
    "diagnose",
    "experiment",
    "feedback",
    "fit",
    "fit_plant",
    "heal",
    "learn",
    "linearize",
    "load",
    "model",
    "plant",
    "plot",
    "save",
    "simulate",
    "simulate_plant",
    "trajectory",
]
