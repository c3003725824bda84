from cubepath.protocol.core.actions import (
    Action as Action,
)
from cubepath.protocol.core.actions import (
    State as State,
)
from cubepath.protocol.core.actions import (
    admissible as admissible,
)
from cubepath.protocol.core.actions import (
    apply as apply,
)
from cubepath.protocol.core.actions import (
    commute as commute,
)
from cubepath.protocol.core.actions import (
    why_inadmissible as why_inadmissible,
)
from cubepath.protocol.core.catalogue import (
    EDGES as EDGES,
)
from cubepath.protocol.core.catalogue import (
    HEXAGONS as HEXAGONS,
)
from cubepath.protocol.core.catalogue import (
    SQUARES as SQUARES,
)
from cubepath.protocol.core.catalogue import (
    Catalogue as Catalogue,
)
from cubepath.protocol.core.catalogue import (
    Generator as Generator,
)
from cubepath.protocol.core.catalogue import GeneratorPlacement as GeneratorPlacement
from cubepath.protocol.core.catalogue import (
    Lattice as Lattice,
)
from cubepath.protocol.core.catalogue import (
    Move as Move,
)
from cubepath.protocol.core.errors import (
    CheckError as CheckError,
)
from cubepath.protocol.core.errors import (
    CubepathError as CubepathError,
)
from cubepath.protocol.core.errors import (
    ExcludedError as ExcludedError,
)
from cubepath.protocol.core.errors import (
    InputError as InputError,
)
from cubepath.protocol.core.errors import (
    RuleError as RuleError,
)
from cubepath.protocol.core.sites import (
    Site as Site,
)
from cubepath.protocol.core.sites import (
    in_order as in_order,
)
from cubepath.protocol.core.sites import (
    site_from_json as site_from_json,
)
from cubepath.protocol.core.system import (
    CLOSED as CLOSED,
)
from cubepath.protocol.core.system import (
    EMPTY as EMPTY,
)
from cubepath.protocol.core.system import (
    FILLED as FILLED,
)
from cubepath.protocol.core.system import (
    FIRST_LABEL as FIRST_LABEL,
)
from cubepath.protocol.core.system import (
    MODULE as MODULE,
)
from cubepath.protocol.core.system import (
    Bound as Bound,
)
from cubepath.protocol.core.system import (
    Scene as Scene,
)
from cubepath.protocol.core.system import (
    System as System,
)
from cubepath.protocol.core.system import VehicleGraph as VehicleGraph
from cubepath.protocol.core.system import (
    Ways as Ways,
)
from cubepath.protocol.path_files.certificates import (
    Certificate as Certificate,
)
from cubepath.protocol.path_files.certificates import (
    certificate_schema as certificate_schema,
)
from cubepath.protocol.path_files.certificates import (
    read_certificate as read_certificate,
)
from cubepath.protocol.path_files.certificates import (
    write_certificate as write_certificate,
)
from cubepath.protocol.path_files.durations import (
    Durations as Durations,
)
from cubepath.protocol.path_files.durations import (
    read_durations as read_durations,
)
from cubepath.protocol.path_files.following import (
    FollowingFile as FollowingFile,
)
from cubepath.protocol.path_files.following import (
    FollowingHead as FollowingHead,
)
from cubepath.protocol.path_files.following import (
    FollowingLine as FollowingLine,
)
from cubepath.protocol.path_files.following import (
    following_schemas as following_schemas,
)
from cubepath.protocol.path_files.following import (
    read_following as read_following,
)
from cubepath.protocol.path_files.following import (
    write_following as write_following,
)
from cubepath.protocol.path_files.following_proofs import (
    FollowingProof as FollowingProof,
)
from cubepath.protocol.path_files.following_proofs import (
    read_following_proof as read_following_proof,
)
from cubepath.protocol.path_files.following_proofs import (
    write_following_proof as write_following_proof,
)
from cubepath.protocol.path_files.moves import (
    MoveName as MoveName,
)
from cubepath.protocol.path_files.moves import (
    PathMove as PathMove,
)
from cubepath.protocol.path_files.moves import (
    cube_schema as cube_schema,
)
from cubepath.protocol.path_files.moves import (
    move_schemas as move_schemas,
)
from cubepath.protocol.path_files.moves import (
    read_cubes as read_cubes,
)
from cubepath.protocol.path_files.moves import (
    read_moves as read_moves,
)
from cubepath.protocol.path_files.moves import (
    write_cubes as write_cubes,
)
from cubepath.protocol.path_files.moves import (
    write_moves as write_moves,
)
from cubepath.protocol.path_files.optimality_proofs import (
    OptimalityProof as OptimalityProof,
)
from cubepath.protocol.path_files.optimality_proofs import (
    read_proof as read_proof,
)
from cubepath.protocol.path_files.optimality_proofs import (
    write_proof as write_proof,
)
from cubepath.protocol.path_files.schedules import (
    TimedLine as TimedLine,
)
from cubepath.protocol.path_files.schedules import (
    read_timetable as read_timetable,
)
from cubepath.protocol.path_files.schedules import (
    timetable_schema as timetable_schema,
)
from cubepath.protocol.path_files.schedules import (
    write_timetable as write_timetable,
)
from cubepath.protocol.plans.formats import PlanHints as PlanHints
from cubepath.protocol.plans.formats import read_plan as read_plan
from cubepath.protocol.plans.imported import (
    VehicleMove as VehicleMove,
)
from cubepath.protocol.plans.imported import (
    VehiclePlan as VehiclePlan,
)
from cubepath.protocol.recordings.cutting import (
    filter_recording as filter_recording,
)
from cubepath.protocol.recordings.cutting import merge_recordings as merge_recordings
from cubepath.protocol.recordings.cutting import (
    split_recording as split_recording,
)
from cubepath.protocol.recordings.recording import (
    Recording as Recording,
)
from cubepath.protocol.recordings.recording import (
    read_recording as read_recording,
)
from cubepath.protocol.recordings.records import Record as Record
from cubepath.protocol.recordings.writing import RecordingWriter as RecordingWriter
from cubepath.protocol.scenes.families.hexagons import hex_catalogue as hex_catalogue
from cubepath.protocol.scenes.family import Family as Family
from cubepath.protocol.scenes.registry import all_families as all_families
from cubepath.protocol.scenes.specs import scene_from_spec as scene_from_spec
from cubepath.protocol.scenes.toml import (
    read_scene as read_scene,
)
from cubepath.protocol.scenes.toml import (
    scene_from_toml as scene_from_toml,
)
from cubepath.protocol.scenes.toml import (
    scene_to_toml as scene_to_toml,
)
from cubepath.protocol.systems.flips import FlipSystem as FlipSystem
from cubepath.protocol.systems.graph import GraphSystem as GraphSystem
from cubepath.protocol.systems.lattice import LatticeSystem as LatticeSystem
from cubepath.protocol.systems.listed import TabledSystem as TabledSystem
from cubepath.protocol.wire.messages import Message as Message
from cubepath.protocol.wire.messages import decode as decode
from cubepath.protocol.wire.on_record import schema_of as schema_of
from cubepath.protocol.wire.sessions import open_client as open_client
