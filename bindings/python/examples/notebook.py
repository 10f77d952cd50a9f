# %% [markdown]
# # outcrop in a notebook
# Jupyter, VS Code and Spyder run these cells one by one. As a script: `python notebook.py`.

# %%
import tempfile
from pathlib import Path

import numpy as np

import outcrop
from outcrop import Buffer

folder = Path(tempfile.mkdtemp())
context = outcrop.Context(memory_budget=256 << 20)

# %% [markdown]
# A height field of half a million triangles, from arrays. Its two halves are two parts.

# %%
side = 500
x, y = np.meshgrid(np.linspace(-2, 2, side + 1), np.linspace(-2, 2, side + 1), indexing="ij")
height = 0.4 * np.sin(3 * x) * np.cos(2 * y) + 0.1 * np.sin(17 * x * y)
vertices = np.stack([x, y, height], -1).reshape(-1, 3)
first = (np.arange(side)[:, None] * (side + 1) + np.arange(side)).ravel()
quads = np.stack([first, first + side + 1, first + side + 2, first + 1], 1)
faces = quads[:, [0, 1, 2, 0, 2, 3]].reshape(-1, 3)
left, right = np.split(faces, 2)

report = context.build(
    folder / "hills.oc",
    {"left": outcrop.Mesh(vertices, left), "right": outcrop.Mesh(vertices, right)},
    options=outcrop.BuildOptions(up=outcrop.UpAxis.Z),
)
print(report.triangles_kept, "triangles,", report.file_bytes, "bytes")

# %% [markdown]
# A picture. The last value of a cell is shown.

# %%
model = context.open(folder / "hills.oc")
scene = context.scene(model)
camera = outcrop.Camera(eye=(3, -4, 3), at=(0, 0, 0), up=(0, 0, 1))
with scene.edit():
    scene.set_lights([
        outcrop.Light(intensity=0.4),
        outcrop.Light(kind=outcrop.LightKind.DIRECTIONAL, vector=(-1, 0.3, -0.7), intensity=0.8, shadows=1),
    ])
picture = context.render(scene, camera, 640, 480, samples=4, buffers=[Buffer.COLOUR_SRGB8, Buffer.DEPTH])
picture.save(folder / "hills.png")
picture

# %% [markdown]
# What lies at a pixel?

# %%
hit = picture.pick(320, 240)
assert hit
print(model.part(hit.part).name, "at", np.round(hit.position, 3), "triangle", hit.prim)

# %% [markdown]
# A million rays straight down measure the height; the error is that of floats.

# %%
random = np.random.default_rng(1)
origins = np.full((1_000_000, 3), 5.0)
origins[:, :2] = random.uniform(-1.9, 1.9, (1_000_000, 2))
hits = scene.closest(origins, (0, 0, -1))
measured = hits["position"][:, 2]
wanted = 0.4 * np.sin(3 * origins[:, 0]) * np.cos(2 * origins[:, 1]) + 0.1 * np.sin(17 * origins[:, 0] * origins[:, 1])
print("mean difference from the formula:", np.abs(measured - wanted).mean())
assert np.abs(measured - wanted).mean() < 1e-3

# %% [markdown]
# Only the left half, in red.

# %%
with scene.edit():
    scene.isolate([model.parts[0].id])
    scene.set_part_look(model.parts[0].id, colour=(0.8, 0.1, 0.05))
context.render(scene, camera, 640, 480)
