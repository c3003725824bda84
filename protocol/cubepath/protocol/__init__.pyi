from cubepath.protocol.core.actions import (
    Action as Action,
    State as State,
    admissible as admissible,
    apply as apply,
    commute as commute,
)
from cubepath.protocol.core.catalogue import (
    EDGES as EDGES,
    HEXAGONS as HEXAGONS,
    SQUARES as SQUARES,
    Catalogue as Catalogue,
    Generator as Generator,
    Lattice as Lattice,
    Move as Move,
)
from cubepath.protocol.core.errors import (
    CheckError as CheckError,
    CubepathError as CubepathError,
    InputError as InputError,
)
from cubepath.protocol.core.sites import Site as Site
from cubepath.protocol.core.system import Scene as Scene, System as System, Ways as Ways
from cubepath.protocol.path_files.following import (
    read_following as read_following,
    read_following_proof as read_following_proof,
    write_following as write_following,
    write_following_proof as write_following_proof,
)
from cubepath.protocol.path_files.moves import (
    PathMove as PathMove,
    read_cubes as read_cubes,
    read_moves as read_moves,
    write_cubes as write_cubes,
)
from cubepath.protocol.path_files.optimality_proofs import (
    OptimalityProof as OptimalityProof,
    read_proof as read_proof,
    write_proof as write_proof,
)
from cubepath.protocol.path_files.path_lines import write_moves as write_moves
from cubepath.protocol.recordings.cutting import (
    filter_recording as filter_recording,
    merge_recordings as merge_recordings,
    split_recording as split_recording,
)
from cubepath.protocol.recordings.recording import (
    Recording as Recording,
    read_recording as read_recording,
)
from cubepath.protocol.recordings.writing import RecordingWriter as RecordingWriter
from cubepath.protocol.scenes.registry import Family as Family
from cubepath.protocol.scenes.specs import scene_from_spec as scene_from_spec
from cubepath.protocol.scenes.toml import read_scene as read_scene, scene_to_toml as scene_to_toml
from cubepath.protocol.systems.flips import FlipSystem as FlipSystem
from cubepath.protocol.systems.graph import GraphSystem as GraphSystem
from cubepath.protocol.systems.lattice import LatticeSystem as LatticeSystem
from cubepath.protocol.systems.listed import TabledSystem as TabledSystem
from cubepath.protocol.wire.messages import decode as decode
from cubepath.protocol.wire.on_record import schema_of as schema_of
from cubepath.protocol.wire.sessions import open_client as open_client
