"""The families whose systems are local: those with environments, runs and shortening."""

from cubepath.protocol.scenes.specs import FAMILIES, scene_from_spec

LOCAL_FAMILIES = [name for name in FAMILIES if scene_from_spec(name).system.local]
