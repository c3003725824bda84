from cubepath.coordinator.auditing.rule_audit import audit as audit
from cubepath.coordinator.experiments.instances import standard as standard
from cubepath.coordinator.experiments.report import SweepReport as SweepReport
from cubepath.coordinator.experiments.sweeping import read_sweep as read_sweep, sweep as sweep
from cubepath.coordinator.normal_form.certificate import certificate_of as certificate_of
from cubepath.coordinator.normal_form.definitions import end_state as end_state
from cubepath.coordinator.normal_form.heap import normal_cube_path as normal_cube_path
from cubepath.coordinator.normal_form.timetable import earliest as earliest
from cubepath.coordinator.playback.machine import PlayerStatus as PlayerStatus
from cubepath.coordinator.playback.player import Player as Player, replay as replay
from cubepath.coordinator.playback.replay_comparison import ReplayResult as ReplayResult
from cubepath.coordinator.runs.asking import ask as ask
from cubepath.coordinator.runs.contents import info as info
from cubepath.coordinator.runs.continuing import what_if as what_if
from cubepath.coordinator.runs.drawing import Sheet as Sheet, run_picture as run_picture
from cubepath.coordinator.runs.gathering import gathered as gathered
from cubepath.coordinator.runs.live import LiveReplay as LiveReplay, replay_live as replay_live
from cubepath.coordinator.runs.outcome import Outcome as Outcome
from cubepath.coordinator.runs.plan import Plan as Plan
from cubepath.coordinator.runs.run import run as run, start as start
from cubepath.coordinator.shortening.conversion import convert as convert
from cubepath.coordinator.shortening.normal_path import Shortened as Shortened, shorten as shorten
from cubepath.coordinator.shortening.path_input import PathInput as PathInput
from cubepath.coordinator.theory.complexes.collapses import collapse as collapse
from cubepath.coordinator.theory.complexes.cubical_complex import CubicalComplex as CubicalComplex
from cubepath.coordinator.theory.complexes.exploration import explore as explore
from cubepath.coordinator.theory.complexes.export import to_networkx as to_networkx
from cubepath.coordinator.theory.complexes.homology_groups import homology as homology
from cubepath.coordinator.theory.complexes.links import check_links as check_links
from cubepath.coordinator.theory.complexes.shape_complexes import (
    lift as lift,
    macro as macro,
    shape_complex as shape_complex,
)
from cubepath.coordinator.theory.complexes.state_complexes import (
    f_vector as f_vector,
    state_complex as state_complex,
)
from cubepath.coordinator.theory.complexes.surfaces import surface as surface
from cubepath.coordinator.theory.following.files import (
    read_vehicle_plan as read_vehicle_plan,
    timetable_file as timetable_file,
)
from cubepath.coordinator.theory.following.timetable import (
    following_timetable as following_timetable,
)
from cubepath.coordinator.theory.optimality.optimality_report import beyond as beyond
from cubepath.coordinator.theory.optimality.tasks import task_of as task_of
from cubepath.coordinator.theory.paper.examples import PaperClaim as PaperClaim
from cubepath.coordinator.theory.proof_checking.following import check_following as check_following
from cubepath.coordinator.theory.proof_checking.following_proof import (
    check_fewest_rounds as check_fewest_rounds,
)
from cubepath.coordinator.theory.proof_checking.optimality import (
    check_optimality as check_optimality,
)
from cubepath.coordinator.theory.search.anytime import improve as improve
from cubepath.coordinator.theory.search.exact import optimum as optimum
from cubepath.coordinator.theory.search.hexagon_plan import hexagon_plan as hexagon_plan
from cubepath.coordinator.theory.search.lower_bounds import lower_bound as lower_bound
from cubepath.coordinator.theory.search.transitions import only_class as only_class
from cubepath.coordinator.tools.comparison.results import RunComparison as RunComparison
from cubepath.coordinator.tools.comparison.run_comparison import diff as diff
from cubepath.coordinator.tools.exports.exporting import export as export
from cubepath.coordinator.tools.live.remote_pages import RemoteRunPage as RemoteRunPage
from cubepath.coordinator.tools.live.watching import LivePage as LivePage
from cubepath.coordinator.tools.recorder.recorder import Recorder as Recorder
from cubepath.coordinator.tools.viewing.pages import (
    page_document as page_document,
    run_page as run_page,
)
from cubepath.coordinator.tools.viewing.run_view import RunView as RunView
from cubepath.coordinator.verification.certificate import check_certificate as check_certificate
from cubepath.coordinator.verification.proof import check_proof as check_proof
from cubepath.coordinator.verification.recording import verify as verify
