"""Where modules of earlier versions are now, so that what users wrote goes on working.

An import of an old name gives the names of the module (or modules) that took its place, with a `DeprecationWarning`.

Rules of this file: a table and its finder; standard library only, and nothing is imported before somebody asks.
"""

from __future__ import annotations

import importlib
import sys
import warnings
from importlib.machinery import ModuleSpec
from types import ModuleType

# Old name -> new name, both within `hoopd`; a module that was taken apart has several.
MOVED: dict[str, str] = {
    "app": "daemon.app",
    "bench": "commands",
    "bench.convert": "commands.convert",
    "bench.design": "commands.design",
    "bench.design_options": "commands.design_options",
    "bench.diagnose": "commands.diagnose",
    "bench.diagnose_inputs": "commands.diagnose_inputs",
    "bench.fit": "commands.fit",
    "bench.fit_options": "commands.fit_options",
    "bench.fit_record": "commands.fit_record",
    "bench.fit_shown": "commands.fit_tables",
    "bench.forterminal": "commands.linear_tables",
    "bench.foundmodel": "commands.diagnosed_model",
    "bench.identify": "commands.identify",
    "bench.identifydata": "commands.identify_data",
    "bench.identifyfigures": "commands.identify_figures",
    "bench.inputs": "commands.inputs",
    "bench.linearize": "commands.linearize",
    "bench.linearrecord": "commands.linearize_record",
    "bench.simulate": "commands.simulate",
    "bench.targets": "commands.output_files",
    "build": "daemon.build",
    "calibrate": "commands.calibrate",
    "check": "daemon.checks",
    "check_device": "daemon.device_checks",
    "cli": "commands.cli",
    "conductor": "daemon.conductor",
    "design.arxlaw": "design.arx_law",
    "design.closed_loop": "plants.hoop.loop.closed_loop",
    "design.closedloop": "plants.hoop.loop.closed_loop",
    "design.controllerfile": "design.controller_text",
    "design.discrete": "ident.discretization",
    "design.effectsnear": "design.effects_near",
    "design.gangoffour": "design.gang_of_four",
    "design.levels": "design.innovation_levels",
    "design.loopshaping": "design.loop_shaping",
    "design.operating": "plants.hoop.loop.operating_points",
    "design.operating_points": "plants.hoop.loop.operating_points",
    "design.trial": "plants.hoop.loop.trial",
    "diagnose.curves.acting": "diagnose.curves.curve_changes",
    "diagnose.curves.effectforce": "diagnose.curves.effect_force",
    "diagnose.curves.locate": "diagnose.curves.location_evidence",
    "diagnose.curves.missingforce": "diagnose.curves.missing_force",
    "diagnose.curves.screen": "diagnose.curves.curve_screen",
    "diagnose.curves.shapes": "diagnose.curves.curve_fits",
    "diagnose.curves.sites": "diagnose.curves.curve_sites",
    "diagnose.curves.unknown": "diagnose.curves.unknown_effects",
    "diagnose.engine": "plants.likelihood",
    "diagnose.engine.calls": "plants.likelihood.batch_calls",
    "diagnose.engine.chain": "plants.likelihood.linear_recursion",
    "diagnose.engine.changes": "diagnose.search.effect_changes",
    "diagnose.engine.composites": "plants.likelihood.composites",
    "diagnose.engine.dataset": "plants.likelihood.stretches",
    "diagnose.engine.filtering": "plants.likelihood.kalman_filter",
    "diagnose.engine.fitting": "plants.likelihood.fitting",
    "diagnose.engine.intervals": "diagnose.quality.unusual_intervals",
    "diagnose.engine.noise": "plants.likelihood.noise_levels",
    "diagnose.engine.ofrecording": "plants.likelihood.recording_parameters",
    "diagnose.engine.priors": "plants.likelihood.priors",
    "diagnose.engine.setaside": "diagnose.quality.excluded_stretches",
    "diagnose.engine.stepcheck": "plants.likelihood.step_halving",
    "diagnose.engine.track": "plants.likelihood.reference_track",
    "diagnose.engine.tuning": "plants.likelihood.noise_tuning",
    "diagnose.engine.unusual": "diagnose.quality.unusual_energy",
    "diagnose.engine.vectorised": "plants.likelihood.vectorised",
    "diagnose.faults": "diagnose.camera_faults",
    "diagnose.place": "diagnose.location",
    "diagnose.proof.apart": "diagnose.proof.separation",
    "diagnose.proof.bestofall": "diagnose.proof.best_of_library",
    "diagnose.proof.compared": "diagnose.proof.window_comparison",
    "diagnose.proof.freechoice": "diagnose.proof.free_run_record",
    "diagnose.proof.freeruns": "diagnose.proof.free_runs",
    "diagnose.proof.freeselect": "diagnose.proof.free_run_selection",
    "diagnose.proof.in_place": "diagnose.proof.rivals_in_place",
    "diagnose.proof.lowered": "diagnose.proof.worse_channels",
    "diagnose.proof.heldout": "diagnose.proof.held_out",
    "diagnose.proof.menu": "diagnose.proof.experiment_menu",
    "diagnose.proof.nextexperiment": "diagnose.proof.next_experiment",
    "diagnose.proof.refine": "diagnose.proof.free_run_refinement",
    "diagnose.proof.refinement": "diagnose.proof.free_run_refinement",
    "diagnose.proof.standing": "diagnose.proof.finding_standings",
    "diagnose.proof.separate": "diagnose.proof.not_excluded",
    "diagnose.proof.tables": "diagnose.proof.fit_tables",
    "diagnose.proof.unnamed": "diagnose.proof.unknown_proof",
    "diagnose.proof.visible": "diagnose.proof.power",
    "diagnose.quality.channels": "diagnose.quality.sensor_samples",
    "diagnose.quality.judged": "diagnose.quality.recording_quality",
    "diagnose.quality.lateframes": "diagnose.quality.late_frames",
    "diagnose.quality.motion": "diagnose.quality.channel_course",
    "diagnose.quality.noisefloor": "diagnose.quality.noise_floor",
    "diagnose.quality.speed": "diagnose.quality.rate_choice",
    "diagnose.quality.split": "diagnose.quality.sample_classes",
    "diagnose.quality.stops": "diagnose.quality.standstill",
    "diagnose.recordfile": "diagnose.record_file",
    "diagnose.report.number_format": "plots.number_format",
    "diagnose.report.pictures": "diagnose.report.curve_pictures",
    "diagnose.report.readable": "plots.number_format",
    "diagnose.report.words": "diagnose.report.sentences",
    "diagnose.search.aside": "diagnose.search.excluded_intervals",
    "diagnose.search.scanned": "diagnose.search.scan_score",
    "diagnose.search.stiff": "diagnose.search.bounded_disturbance",
    "diagnose.search.trying": "diagnose.search.candidates",
    "diagnose.shown": "diagnose.report_curves",
    "effectsfile": "plants.effects_file",
    "excitationfile": "files.excitation",
    "experiment": "daemon.experiment",
    "experimentplan": "plants.hoop.loop.experiment_plan",
    "eye": "shell.ball_detection",
    "failure": "uncaught_errors",
    "ident.device": "plants.fits",
    "ident.device.constraints": "plants.hoop.fitting.entry_constraints",
    "ident.device.determined": "plants.hoop.fitting.identifiability plants.fits.undetermined",
    "ident.device.experiments": "plants.hoop.recordings.fit_data plants.fits.repeated_samples",
    "ident.device.fit": "plants.hoop.fitting.fit",
    "ident.device.freerun": "plants.hoop.recordings.recorded_runs",
    "ident.device.gaussnewton": "plants.fits.robust_least_squares",
    "ident.device.innovations": "plants.likelihood.extended_filter plants.hoop.fitting.filter_noise",
    "ident.device.kinematics": "plants.hoop.kinematics",
    "ident.device.likelihood": "plants.likelihood.innovation_likelihood",
    "ident.device.noise": "plants.hoop.fitting.filter_noise plants.likelihood.noise_scale",
    "ident.device.outputerror": "plants.hoop.fitting.hoop_output_error plants.fits.output_error",
    "ident.device.parameters": "plants.hoop.fitting.free_parameters plants.fits.free_parameters",
    "ident.device.physical": "plants.hoop.fitting.physical_parameters",
    "ident.device.plain": "plants.fits.plain_numbers",
    "ident.device.prediction": "plants.hoop.fitting.hoop_prediction_error plants.likelihood.prediction_error",
    "ident.device.score": "plants.hoop.fitting.fit_percent plants.fits.nrmse",
    "ident.device.scoring": "plants.likelihood.likelihood_search",
    "ident.device.separating": "plants.hoop.fitting.separating_measurement",
    "ident.device.solvers": "plants.hoop.fitting.solver_comparison",
    "ident.device.thesis": "plants.hoop.thesis",
    "ident.device.uncertainty": "plants.fits.uncertainty",
    "ident.device.whiteness": "plants.likelihood.innovation_tests",
    "identifiedfile": "files.identified",
    "modelfiles": "plants.model_file files.controller files.model",
    "output": "commands.output",
    "physics": "plants",
    "physics.compensation": "plants.compensation",
    "physics.composite": "plants.plant_with_effects",
    "physics.declared": "plants.declaration plants.former_declaration plants.hoop.declaration plants.hoop.contact",
    "physics.effectmodel": "plants.hoop.simulate",
    "physics.effectplant": "plants.hoop.plant",
    "physics.effects": "plants.effects",
    "physics.effects.actuator": "plants.effects.drive",
    "physics.effects.ball": "plants.hoop.effects.ball_effects",
    "physics.effects.base": "plants.effects.base",
    "physics.effects.camera": "plants.effects.image_sensor",
    "physics.effects.catalogue": "plants.effects.library",
    "physics.effects.encoder": "plants.effects.angle_sensor",
    "physics.effects.external": "plants.effects.push",
    "physics.effects.frame": "plants.hoop.effects.frame_effects",
    "physics.effects.hoop": "plants.effects.body",
    "physics.effects.liftoff": "plants.hoop.effects.lift_off",
    "physics.effects.normal": "plants.hoop.effects.normal_force",
    "physics.effects.slip": "plants.hoop.effects.slip",
    "physics.effects.slots": "plants.effects.usual_sizes",
    "physics.entries": "plants.hoop.entries",
    "physics.equations": "plants.hoop.equations",
    "physics.flight": "plants.hoop.effects.flight",
    "physics.found": "plants.found_effects",
    "physics.freerun": "plants.free_run",
    "physics.held": "plants.held_input",
    "physics.motion": "plants.integration_step",
    "physics.parameters": "plants.hoop.parameters",
    "physics.plant": "plants.hoop.plant plants.numeric_plant plants.compiled",
    "physics.simulate": "plants.hoop.simulate",
    "physics.truereadings": "plants.hoop.recordings.sensor_correction",
    "plants.composite": "plants.plant_with_effects",
    "plants.effects.slots": "plants.effects.usual_sizes",
    "plants.free_run_model": "plants.free_run",
    "plants.hoop.ball_effects": "plants.hoop.effects.ball_effects",
    "plants.hoop.closed_loop": "plants.hoop.loop.closed_loop",
    "plants.hoop.entry_constraints": "plants.hoop.fitting.entry_constraints",
    "plants.hoop.experiment_plan": "plants.hoop.loop.experiment_plan",
    "plants.hoop.filter_noise": "plants.hoop.fitting.filter_noise",
    "plants.hoop.fit": "plants.hoop.fitting.fit",
    "plants.hoop.fit_data": "plants.hoop.recordings.fit_data",
    "plants.hoop.fit_percent": "plants.hoop.fitting.fit_percent",
    "plants.hoop.flight": "plants.hoop.effects.flight",
    "plants.hoop.flying_plant": "plants.hoop.effects.flying_plant",
    "plants.hoop.frame_effects": "plants.hoop.effects.frame_effects",
    "plants.hoop.free_parameters": "plants.hoop.fitting.free_parameters",
    "plants.hoop.identifiability": "plants.hoop.fitting.identifiability plants.fits.undetermined",
    "plants.hoop.innovation_likelihood": "plants.likelihood.innovation_likelihood",
    "plants.hoop.innovation_tests": "plants.likelihood.innovation_tests",
    "plants.hoop.innovations": "plants.likelihood.extended_filter plants.hoop.fitting.filter_noise",
    "plants.hoop.lift_off": "plants.hoop.effects.lift_off",
    "plants.hoop.likelihood_search": "plants.likelihood.likelihood_search",
    "plants.hoop.normal_force": "plants.hoop.effects.normal_force",
    "plants.hoop.operating_points": "plants.hoop.loop.operating_points",
    "plants.hoop.output_error": "plants.hoop.fitting.hoop_output_error",
    "plants.hoop.physical_parameters": "plants.hoop.fitting.physical_parameters",
    "plants.hoop.prediction_error": "plants.hoop.fitting.hoop_prediction_error",
    "plants.hoop.recorded_runs": "plants.hoop.recordings.recorded_runs",
    "plants.hoop.sensor_correction": "plants.hoop.recordings.sensor_correction",
    "plants.hoop.separating_measurement": "plants.hoop.fitting.separating_measurement",
    "plants.hoop.slip": "plants.hoop.effects.slip",
    "plants.hoop.solver_comparison": "plants.hoop.fitting.solver_comparison",
    "plants.hoop.suspicions": "plants.hoop.recordings.suspicions",
    "plants.hoop.trial": "plants.hoop.loop.trial",
    "plants.hoop.writeback": "plants.hoop.loop.writeback",
    "plants.motion": "plants.integration_step",
    "plots.diagnosiscurves": "plots.diagnosis_curves",
    "plots.printedmargin": "plots.printed_margin",
    "recording.bytesof": "files.whole_files",
    "recording.csvfile": "recording.csv_file",
    "recording.matfile": "recording.mat_file",
    "recording.suspicions": "plants.hoop.recordings.suspicions",
    "replay": "daemon.replay",
    "report": "daemon.report",
    "shipped": "files.shipped",
    "sim.hidden": "sim.plant",
    "sinks": "daemon.sinks",
    "spans": "recording.spans",
    "trackingerror": "daemon.tracking_error",
    "world": "daemon.world",
    "writeback": "plants.hoop.loop.writeback",
    "yamltext": "files.yaml_text",
}
# Names that have moved or were renamed within modules that still answer: MODULE.NAME -> MODULE.NAME, within `hoopd`.
RENAMED: dict[str, str] = {
    "commands.plant_linear.LinearPlant": "commands.plant_linear.LinearizedPlant",
    "core.ballresponse.Fit": "core.ballresponse.WindowFit",
    "core.feedforward.Part": "core.feedforward.FeedForwardPart",
    "design.linear_plant.NoEquilibriumError": "design.linear_plant.EquilibriumNotFoundError",
    "design.loop_shaping.Point": "design.loop_shaping.FrequencyPoint",
    "diagnose.camera_faults.CameraFault": "diagnose.camera_faults.CountedFault",
    "diagnose.camera_faults.Fault": "diagnose.camera_faults.CountedFault",
    "diagnose.curves.curve.Curve": "diagnose.curves.curve.UnnamedCurve",
    "diagnose.curves.curve_sites.Variable": "diagnose.curves.curve_sites.CurveVariable",
    "diagnose.curves.effect_force.Missing": "diagnose.curves.effect_force.MissingForceSamples",
    "diagnose.quality.sensor_samples.Channel": "diagnose.quality.sensor_samples.JudgedSamples",
    "diagnose.quality.unusual_intervals.Signal": "diagnose.quality.unusual_intervals.UnusualSignal",
    "diagnose.report_curves.Law": "diagnose.report_curves.LawCurve",
    "diagnose.search.adjoint.Answer": "diagnose.search.adjoint.AdjointAnswer",
    "diagnose.search.excluded_intervals.Data": "diagnose.search.excluded_intervals.CountedData",
    "diagnose.search.tones.Spectrum": "diagnose.search.tones.GainSpectrum",
    "files.expressions.Span": "files.expressions.TextSpan",
    "ident.conditioning.Unit": "ident.conditioning.UnitVariance",
    "ident.excitation.Excitation": "ident.excitation.ExcitationOrder",
    "ident.kernels.Given": "ident.kernels.TriangularRows",
    "ident.kernels.Shape": "ident.kernels.KernelShape",
    "ident.polynomial.gaussnewton.Evaluation": "ident.polynomial.gaussnewton.PolynomialErrors",
    "ident.polynomial.gaussnewton.Stretch": "ident.polynomial.gaussnewton.PolynomialExperiment",
    "ident.polynomial.orders.Candidate": "ident.polynomial.orders.OrderCandidate",
    "ident.polynomial.orders.Scan": "ident.polynomial.orders.OrderScan",
    "ident.rationalproblem.Problem": "ident.rationalproblem.RationalProblem",
    "ident.spectral.Estimate": "ident.spectral.FrequencyEstimate",
    "ident.statespace.frequencysubspace.Known": "ident.statespace.frequencysubspace.GivenMatrices",
    "ident.statespace.gaussnewton.Point": "ident.statespace.gaussnewton.PemPoint",
    "ident.statespace.gaussnewton.Problem": "ident.statespace.gaussnewton.PemProblem",
    "ident.statespace.hammersteinerrors.Point": "ident.statespace.hammersteinerrors.SearchPoint",
    "ident.statespace.hammersteinerrors.Task": "ident.statespace.hammersteinerrors.HammersteinTask",
    "ident.statespace.inputs.Inputs": "ident.statespace.inputs.InputMatrices",
    "ident.statespace.pem.Options": "ident.statespace.pem.PemSettings",
    "ident.statespace.projection.Factor": "ident.statespace.projection.TriangularFactor",
    "ident.statespace.projection.Split": "ident.statespace.projection.WindowSplit",
    "ident.statespace.sensitivities.Trajectory": "ident.statespace.sensitivities.PredictionTrajectory",
    "ident.statespace.subspace.Choice": "ident.statespace.subspace.SubspaceChoice",
    "ident.statespace.subspace.Scale": "ident.statespace.subspace.ChannelScale",
    "ident.statespace.unscented.System": "ident.statespace.unscented.NonlinearSystem",
    "plants.declaration.DeclaredPlant": "plants.former_declaration.DeclaredPlant",
    "plants.declaration.Mode": "plants.declaration.MotionMode",
    "plants.fits.plant_runs.PlantModel": "plants.fits.plant_runs.PlantReadings",
    "plants.fits.runs.Series": "plants.fits.runs.ChannelSeries",
    "plants.free_run_model.FreeRunModel": "plants.free_run.FreeRun",
    "plants.found_effects.Found": "plants.found_effects.FoundEffects",
    "plants.hoop.loop.closed_loop.Run": "plants.hoop.loop.closed_loop.ClosedLoopRun",
    "plants.hoop.loop.experiment_plan.Score": "plants.hoop.loop.experiment_plan.FinishedPlan",
    "plants.hoop.fitting.fit.Fit": "plants.hoop.fitting.fit.FittedParameters",
    "plants.hoop.fitting.fit.Settings": "plants.hoop.fitting.fit.FitSettings",
    "plants.hoop.fitting.fit_percent.Score": "plants.hoop.fitting.fit_percent.FitScore",
    "plants.hoop.fitting.fit_percent.Trace": "plants.hoop.fitting.fit_percent.ChannelTrace",
    "plants.hoop.innovations.Innovations": "plants.likelihood.extended_filter.FilterInnovations",
    "ident.device.innovations.Innovations": "plants.likelihood.extended_filter.FilterInnovations",
    "ident.device.innovations.InnovationsFilter": "plants.likelihood.extended_filter.ExtendedKalmanFilter",
    "plants.hoop.innovations.InnovationsFilter": "plants.likelihood.extended_filter.ExtendedKalmanFilter",
    "plants.hoop.recordings.recorded_runs.FreeRun": "plants.hoop.recordings.recorded_runs.SimulatedStretch",
    "plants.hoop.fitting.separating_measurement.Candidate": "plants.hoop.fitting.separating_measurement.FurtherMeasurement",  # noqa: E501
    "plants.hoop.simulate.Model": "plants.hoop.simulate.HoopModel",
    "plants.hoop.fitting.solver_comparison.Case": "plants.hoop.fitting.solver_comparison.SolverCase",
    "plants.likelihood.fitting.Fit": "plants.likelihood.fitting.HypothesisFit",
    "plants.likelihood.kalman_filter.Linear": "plants.likelihood.kalman_filter.LinearReference",
    "plants.likelihood.kalman_filter.Smoothed": "plants.likelihood.kalman_filter.SmoothedDeviation",
    "plants.likelihood.vectorised.Operation": "plants.likelihood.vectorised.VectorOperation",
    "plots.experiment.Limits": "plots.experiment.ExperimentLimits",
    "plots.linearity.Compared": "plots.linearity.ComparedRuns",
    "recording.by_name.Field": "recording.by_name.NamedValues",
    "recording.column_choice.Layout": "recording.column_choice.SignalLayout",
    "recording.container.Sink": "recording.container.ByteSink",
    "recording.matlab_objects.Column": "recording.matlab_objects.TableVariable",
    "recording.mcap.Run": "recording.mcap.RecordedRun",
    "recording.schemas.Event": "recording.schemas.LogEvent",
    "recording.schemas.Field": "recording.schemas.FieldDescription",
    "recording.timeline.Channel": "recording.timeline.ChannelNodes",
    "shell.commands.Outcome": "shell.commands.CommandOutcome",
    "shell.commandserver.Request": "shell.commandserver.CommandRequest",
    "shell.config.Circle": "shell.config.CircleConfig",
    "shell.config.Limits": "shell.config.LimitsConfig",
    "shell.config.Recording": "shell.config.RecordingConfig",
    "shell.config.Telemetry": "shell.config.TelemetryConfig",
    "shell.peer.Peer": "shell.peer.ZenohPeer",
    "shell.telemetry.Settings": "shell.telemetry.TelemetrySettings",
    "sim.board.Plant": "sim.board.BoardPlant",
    "sim.faults.Fault": "sim.faults.ScriptedFault",
    "sim.lockstep.Codec": "sim.lockstep.HostCodec",
    "sim.lockstep.Moved": "sim.lockstep.MovedPlant",
    "sim.plant.HiddenPlant": "sim.plant.RigPlant",
    "sim.torque_log.Sink": "sim.torque_log.TorqueSink",
    "vision.blobs.Shape": "vision.blobs.BlobShape",
    "vision.candidates.Candidate": "vision.candidates.BallCandidate",
    "design.analysis.numerator_and_denominator": "ident.transfer_functions.numerator_and_denominator",
    "design.analysis.transfer_function": "ident.transfer_functions.transfer_function",
    "design.analysis.zeros": "ident.transfer_functions.zeros",
    "physics.plant.Plant": "plants.hoop.plant.HoopPlant",
}
PREFIX = "hoopd."


def renamed(module: str, name: str) -> object:
    """What a module's old name stands for now, with a warning: for a module's `__getattr__`; AttributeError."""
    place = RENAMED.get(f"{module.removeprefix(PREFIX)}.{name}")
    if place is None:
        raise AttributeError(f"module {module!r} has no attribute {name!r}")
    target, _, new = place.rpartition(".")
    warnings.warn(f"{module}.{name} is now {PREFIX}{place}", DeprecationWarning, stacklevel=3)
    return getattr(importlib.import_module(PREFIX + target), new)


class MovedModules:
    """Finder and loader of the old names; it comes last on `sys.meta_path`."""

    def find_spec(self, name: str, path: object = None, target: object = None) -> ModuleSpec | None:
        """A spec for an old name, None for every other one."""
        if not name.startswith(PREFIX) or name.removeprefix(PREFIX) not in MOVED:
            return None
        return ModuleSpec(name, self, is_package=True)  # type: ignore[arg-type]  # a loader by its two methods

    def create_module(self, spec: ModuleSpec) -> ModuleType:
        """An empty module that looks its names up where they are now."""
        targets = [PREFIX + name for name in MOVED[spec.name.removeprefix(PREFIX)].split()]
        return Moved(spec.name, targets)

    def exec_module(self, module: ModuleType) -> None:
        """Nothing runs: the names are looked up when they are asked for."""
        assert isinstance(module, Moved)
        places = " and ".join(module.targets)
        warnings.warn(f"{module.__name__} is now {places}", DeprecationWarning, stacklevel=2)


class Moved(ModuleType):
    """A module under its old name."""

    def __init__(self, name: str, targets: list[str]) -> None:
        super().__init__(name)
        self.targets = targets

    def __getattr__(self, name: str) -> object:
        if f"{self.__name__.removeprefix(PREFIX)}.{name}" in RENAMED:
            return renamed(self.__name__, name)
        if not name.startswith("__"):
            for target in self.targets:
                module = importlib.import_module(target)
                if hasattr(module, name):
                    return getattr(module, name)
                if f"{target.removeprefix(PREFIX)}.{name}" in RENAMED:
                    return renamed(target, name)
        raise AttributeError(f"module {self.__name__!r} has no attribute {name!r}")


def install() -> None:
    """Make the old names importable; a second call changes nothing."""
    if not any(isinstance(finder, MovedModules) for finder in sys.meta_path):
        sys.meta_path.append(MovedModules())
