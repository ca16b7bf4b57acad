"""The table and the blocks as composer entities. Lengths are in metres, masses in kilograms."""

from dm_control import composer, mjcf

from curiobench.tasks.goal_names import BLOCK_NAMES
from curiobench.tasks.placements import BLOCK_SIZE

TABLE_CENTRE = (1.30, 0.75, 0.20)
TABLE_HALF_SIZE = (0.25, 0.35, 0.20)
TABLE_HEIGHT = TABLE_CENTRE[2] + TABLE_HALF_SIZE[2]

BLOCK_MASS = 2.0
BLOCK_JOINT_DAMPING = 0.01
BLOCK_REST_HEIGHT = TABLE_HEIGHT + BLOCK_SIZE / 2
BLOCK_COLOURS = (
    (0.84, 0.24, 0.22, 1.0),
    (0.28, 0.62, 0.33, 1.0),
    (0.22, 0.45, 0.78, 1.0),
    (0.94, 0.72, 0.20, 1.0),
    (0.55, 0.35, 0.65, 1.0),
)
"""Red, green and blue as in the paper; yellow and purple for a fourth and a fifth block."""

CAMERA = "overview"
"""Name of the default camera for rendering."""


class TableArena(composer.Arena):
    """A table on a floor, with the lights and the camera for rendering."""

    def _build(self, name: str = "arena") -> None:
        super()._build(name=name)
        root = self.mjcf_model
        root.statistic.set_attributes(extent=1.0, center=(1.3, 0.75, 0.45))
        root.visual.headlight.set_attributes(ambient=(0.35, 0.35, 0.35), diffuse=(0.35, 0.35, 0.35))
        root.visual.quality.shadowsize = 4096
        getattr(root.visual, "global").set_attributes(offwidth=1920, offheight=1440)
        root.visual.map.set_attributes(znear=0.02, zfar=20.0)
        root.asset.add(
            "texture", name="sky", type="skybox", builtin="gradient",
            rgb1=(0.93, 0.95, 0.97), rgb2=(0.78, 0.82, 0.87), width=256, height=256,
        )  # fmt: skip
        # a spot light, because the shadow map of a directional light covers the entire floor and gets grainy
        root.worldbody.add("light", pos=(0.7, 0.1, 2.4), dir=(0.6, 0.65, -2.0), diffuse=(0.55, 0.55, 0.55),
                           specular=(0.1, 0.1, 0.1), cutoff=50, exponent=1, castshadow=True)  # fmt: skip
        root.worldbody.add("camera", name=CAMERA, pos=(1.98, 0.20, 0.98), xyaxes=(0.6, 0.8, 0, -0.46, 0.345, 0.818),
                           fovy=42)  # fmt: skip
        root.worldbody.add("geom", name="floor", type="plane", size=(3, 3, 0.1), rgba=(0.70, 0.72, 0.74, 1))
        root.worldbody.add(
            "geom", name="table", type="box", pos=TABLE_CENTRE, size=TABLE_HALF_SIZE, rgba=(0.78, 0.75, 0.70, 1)
        )


class Block(composer.Entity):
    """One free cube. Its friction, contact and inertia are MuJoCo's defaults for a box of its mass."""

    def _build(self, index: int) -> None:
        """Builds block number `index`: 0 is a, 1 is b, …"""
        self._mjcf_model = mjcf.RootElement(model=f"block_{BLOCK_NAMES[index]}")
        self._mjcf_model.worldbody.add(
            "geom", name="block", type="box", size=[BLOCK_SIZE / 2] * 3, mass=BLOCK_MASS, condim=3,
            rgba=BLOCK_COLOURS[index],
        )  # fmt: skip

    @property
    def mjcf_model(self) -> mjcf.RootElement:
        return self._mjcf_model

    def add_to(self, arena: composer.Arena) -> mjcf.Element:
        """Attaches the block to `arena` by a free joint, which it returns."""
        frame = arena.attach(self)
        # not `add_free_entity`: MJCF's <freejoint> takes no damping
        return frame.add("joint", name="free", type="free", damping=BLOCK_JOINT_DAMPING)
