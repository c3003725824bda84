"""The families whose systems are local: those with environments, runs and shortening."""

from cubepath.protocol.scenes.registry import all_families
from cubepath.protocol.scenes.specs import scene_from_spec

LOCAL_FAMILIES = [name for name in all_families() if scene_from_spec(name).system.local]
