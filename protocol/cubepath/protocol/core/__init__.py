"""The formal core: sites, actions, what commutes, catalogues, systems and scenes.

Room: protocol. It holds the definitions of the paper and what every reader of files needs. It knows
no kind of system, no file format and no message. It imports no other room; every room may import
it.
"""

from typing import TYPE_CHECKING

from cubepath.protocol.faces import lazy_face

if TYPE_CHECKING:
    from cubepath.protocol.core.actions import (
        Action,
        State,
        action_of_parts,
        admissible,
        apply,
        apply_in_place,
        commute,
        end_at,
        why_inadmissible,
    )
    from cubepath.protocol.core.catalogue import (
        EDGES,
        HEX_DIRECTIONS,
        HEXAGONS,
        LATTICES,
        SQUARES,
        Catalogue,
        Cell,
        Generator,
        Lattice,
        Move,
    )
    from cubepath.protocol.core.control_characters import visible
    from cubepath.protocol.core.errors import (
        CheckError,
        CubepathError,
        ExcludedError,
        InputError,
        RuleError,
        bounded,
    )
    from cubepath.protocol.core.given import function, real_number, seconds, whole_number
    from cubepath.protocol.core.input_files import (
        BYTE_ORDER_MARK,
        STANDARD_INPUT,
        InputFile,
        Source,
        check_not_empty,
        file_within,
        opened,
        read_text,
        readable,
    )
    from cubepath.protocol.core.json_keys import check_keys
    from cubepath.protocol.core.keyed_values import Keys, all_values, given_values
    from cubepath.protocol.core.names import GeneratorPlacement, Json, schema_with_definitions
    from cubepath.protocol.core.ordinals import Ordinals
    from cubepath.protocol.core.output_files import (
        STANDARD_OUTPUT,
        appended_file,
        check_output,
        check_output_folder,
        is_special,
        locked_file,
        new_file,
        same_file,
        special_file,
        unwritable,
        written_whole,
    )
    from cubepath.protocol.core.plurals import counted
    from cubepath.protocol.core.sites import (
        DEPTH_MAX,
        Site,
        in_order,
        pairs_from_json,
        site_from_json,
        site_text,
        sites_from_json,
        to_json,
    )
    from cubepath.protocol.core.suggestions import did_you_mean
    from cubepath.protocol.core.system import (
        CLOSED,
        EMPTY,
        FAR,
        FILLED,
        FIRST_LABEL,
        KEPT,
        MODULE,
        Bound,
        Scene,
        System,
        Ways,
        local_only,
        one_to_one,
        region_of,
    )
    from cubepath.protocol.core.toml_text import parsed_toml
    from cubepath.protocol.core.vehicle_graph import VehicleGraph
else:
    __getattr__, __dir__ = lazy_face(
        __name__,
        {
            "actions": (
                "Action State action_of_parts admissible apply apply_in_place commute end_at "
                "why_inadmissible"
            ),
            "catalogue": (
                "Catalogue Cell EDGES Generator HEXAGONS HEX_DIRECTIONS LATTICES Lattice Move "
                "SQUARES"
            ),
            "control_characters": "visible",
            "plurals": "counted",
            "errors": "CheckError CubepathError ExcludedError InputError RuleError bounded",
            "given": "function real_number seconds whole_number",
            "input_files": (
                "BYTE_ORDER_MARK InputFile STANDARD_INPUT Source check_not_empty file_within opened"
                " read_text readable"
            ),
            "json_keys": "check_keys",
            "keyed_values": "Keys all_values given_values",
            "names": "GeneratorPlacement Json schema_with_definitions",
            "ordinals": "Ordinals",
            "output_files": (
                "STANDARD_OUTPUT appended_file check_output check_output_folder is_special"
                " locked_file new_file same_file special_file unwritable written_whole"
            ),
            "sites": (
                "DEPTH_MAX Site in_order pairs_from_json site_from_json site_text "
                "sites_from_json to_json"
            ),
            "suggestions": "did_you_mean",
            "system": (
                "Bound CLOSED EMPTY FAR FILLED FIRST_LABEL KEPT MODULE Scene System Ways "
                "local_only one_to_one region_of"
            ),
            "toml_text": "parsed_toml",
            "vehicle_graph": "VehicleGraph",
        },
    )

__all__ = [
    "BYTE_ORDER_MARK",
    "CLOSED",
    "DEPTH_MAX",
    "EDGES",
    "EMPTY",
    "FAR",
    "FILLED",
    "FIRST_LABEL",
    "HEXAGONS",
    "HEX_DIRECTIONS",
    "KEPT",
    "LATTICES",
    "MODULE",
    "SQUARES",
    "STANDARD_INPUT",
    "STANDARD_OUTPUT",
    "Action",
    "Bound",
    "Catalogue",
    "Cell",
    "CheckError",
    "CubepathError",
    "ExcludedError",
    "Generator",
    "GeneratorPlacement",
    "InputError",
    "InputFile",
    "Json",
    "Keys",
    "Lattice",
    "Move",
    "Ordinals",
    "RuleError",
    "Scene",
    "Site",
    "Source",
    "State",
    "System",
    "VehicleGraph",
    "Ways",
    "action_of_parts",
    "admissible",
    "all_values",
    "appended_file",
    "apply",
    "apply_in_place",
    "bounded",
    "check_keys",
    "check_not_empty",
    "check_output",
    "check_output_folder",
    "commute",
    "counted",
    "did_you_mean",
    "end_at",
    "file_within",
    "function",
    "given_values",
    "in_order",
    "is_special",
    "local_only",
    "locked_file",
    "new_file",
    "one_to_one",
    "opened",
    "pairs_from_json",
    "parsed_toml",
    "read_text",
    "readable",
    "real_number",
    "region_of",
    "same_file",
    "schema_with_definitions",
    "seconds",
    "site_from_json",
    "site_text",
    "sites_from_json",
    "special_file",
    "to_json",
    "unwritable",
    "visible",
    "whole_number",
    "why_inadmissible",
    "written_whole",
]
