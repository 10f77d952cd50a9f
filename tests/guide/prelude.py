# The variables of a Python snippet of the guide, which tests/guide.rs appends.
import outcrop

context = outcrop.Context(threads=2)
model = context.open("pump.oc")
scene = context.scene([(1, model)])
camera = model.view(0)
frame = context.render(scene, camera, 160, 120)

