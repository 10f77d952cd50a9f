"""Scenes: instances of models, lights, and the looks of parts."""

from __future__ import annotations

import ctypes as c
import os
from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager
from typing import Any, Union

import numpy
from numpy.typing import ArrayLike

from . import _abi
from ._arrays import OVERLAP, Array, address, ids, masks_of, matrix, tints_of, transforms_of
from ._clashes import Clashes
from ._enums import LookFlags, PartsFlags
from ._handles import Reference, made
from ._library import lib
from ._model import Model
from ._nearest import Distances
from ._queries import Queries
from ._value import Vector, numbers, whole
from ._values import Background, Camera, Fit, Light

Placed = Union[Model, "tuple[int, Model]", "tuple[int, Model, ArrayLike | None]"]
"""An instance: a model, or (id, model), or (id, model, transform)."""


class Scene(Queries, Clashes, Distances):
    """Instances of models, lights and looks. Edits take effect together, at `commit()` or at the end of `edit()`.

    Frames and batches in flight keep the state that they began with.
    """

    _kind = "Scene"
    _release = lib.oc_scene_release

    def __init__(self, context: Reference, path: bytes | None = None) -> None:
        made_by = made(lib.oc_scene_create, context) if path is None else made(lib.oc_scene_open, context, path)
        super().__init__(made_by, context)

    def commit(self) -> None:
        """Makes all edits since the last commit take effect, for all that begins later."""
        lib.oc_scene_commit(self._h)

    def save(self, path: str | os.PathLike[str]) -> None:
        """Saves what the last commit has in a scene file, which `Context.open_scene` opens.

        It names the models by their paths, relative to its own folder. A model that was not opened from a path, and
        looks of parts or of single occurrences, cannot be saved: StateError, which names them.
        """
        lib.oc_scene_save(self._h, os.fsencode(path))

    @contextmanager
    def edit(self) -> Iterator[Scene]:
        """Commits at the end of the `with` block, unless it raises an exception."""
        yield self
        self.commit()

    def add(self, id: int, model: Model, transform: ArrayLike | None = None) -> None:
        """Adds a model as an instance.

        id: your own, unique in the scene.
        transform: a (4, 4) or (3, 4) matrix that transforms columns, or 12 numbers by column (x axis, y axis, z axis,
            origin). None: the identity.
        """
        lib.oc_scene_add_instance(self._h, model._h, whole("id", id), matrix("transform", transform))

    def add_all(self, instances: Placed | Iterable[Placed]) -> None:
        """Adds instances. Models without an id get 1, 2, 3, ..."""
        listed = [instances] if isinstance(instances, Model) else list(instances)
        for number, one in enumerate(listed, 1):
            if isinstance(one, Model):
                self.add(number, one)
            elif isinstance(one, tuple) and len(one) in (2, 3) and isinstance(one[1], Model):
                self.add(*one)
            else:
                raise TypeError(f"instances[{number - 1}]: expected a Model, (id, model) or (id, model, transform), "
                                f"not {one!r}")

    def add_instances(self, models: Model | Scene | Sequence[Model] | Sequence[Scene], transforms: ArrayLike, *,
                      first_id: int, model_of: ArrayLike | None = None, mask: int = 0xFFFFFFFF,
                      masks: ArrayLike | None = None, tints: ArrayLike | None = None) -> None:
        """Adds many instances of one model or scene, or of a few, with the ids first_id, first_id + 1, ...

        models: all models, or all scenes, as `add_scene` describes.
        transforms: n of them: dtype `PLACE`, or float64 or float32 with 12 numbers by column each (x axis, y axis,
            z axis, origin), as (n, 12) or (n, 4, 3).
        model_of: n indices among `models`. None: all are of the first.
        mask: see `set_mask`.
        masks: n masks: a ray hits an instance only if its mask has a bit in common with both this one and `mask`.
        tints: (n, 3) or (n, 4) integers from 0 to 255: factors to linear red, green, blue and to the opacity of all
            that an instance shows, where 255 stands for 1. Colours of looks have no tint.

        None of them can be removed alone or given another model; otherwise they are like those of `add`.
        """
        listed = [models] if isinstance(models, (Model, Scene)) else list(models)
        if len({isinstance(one, Scene) for one in listed}) > 1:
            raise TypeError("models: expected models or scenes, not both")
        are_scenes = bool(listed) and isinstance(listed[0], Scene)
        packed, form = transforms_of("transforms", transforms)
        which = None if model_of is None else numpy.ascontiguousarray(model_of, numpy.uint32)
        if which is not None and which.shape != (len(packed),):
            raise ValueError(f"model_of: expected the shape ({len(packed)},), not {which.shape}")
        if whole("mask", mask, 32) == 0:
            raise ValueError("mask: 0 hides the instances from all rays; use set_mask or set_look")
        own = None if masks is None else masks_of(masks, len(packed))
        tinted = None if tints is None else tints_of(tints, len(packed))
        prototypes = (c.c_void_p * len(listed))(*[model._h._as_parameter_ for model in listed])
        names = ("scenes", "scene_count") if are_scenes else ("prototypes", "prototype_count")
        given = dict(zip(names, (c.addressof(prototypes), len(listed))))
        lib.oc_scene_add_instances(self._h, c.byref(_abi.oc_instances(
            form=form, **given,
            prototype_of=None if which is None else address(which), transforms=address(packed), count=len(packed),
            first_id=whole("first_id", first_id), mask=mask,
            masks=None if own is None else address(own),
            tints=None if tinted is None else address(tinted))))

    def add_scene(self, id: int, inner: Scene, transform: ArrayLike | None = None) -> None:
        """Adds a scene as an instance. Each commit takes it as it was committed last. See `add`.

        Scenes may be in scenes, up to 64 levels, and one scene any number of times.
        """
        lib.oc_scene_add_scene(self._h, inner._h, whole("id", id), matrix("transform", transform))

    def path(self, occurrence: int) -> tuple[list[int], Array]:
        """Returns the way to what a hit met: the ids of the instances, the outermost first, and the (4, 4) matrix that
        takes the innermost to the world.

        occurrence: `hit["occurrence"]` of a hit since the last commit, or a value of `Buffer.OCCURRENCE` in a picture
        that was requested since then.
        """
        count, world = c.c_uint64(), (c.c_double * 12)()
        number = whole("occurrence", int(occurrence))
        lib.oc_scene_get_path(self._h, number, None, 0, c.byref(count), world)
        listed = (c.c_uint64 * count.value)()
        lib.oc_scene_get_path(self._h, number, listed, count.value, c.byref(count), None)
        place = numpy.eye(4)
        place[:3] = numpy.array(world).reshape(4, 3).T
        return list(listed), place

    def set_transforms(self, first_id: int, transforms: ArrayLike) -> None:
        """Moves instances of an array, with the ids first_id, first_id + 1, ...

        transforms: as for `add_instances`, with the dtype of the array's.
        """
        packed, form = transforms_of("transforms", transforms)
        lib.oc_scene_set_transforms(self._h, whole("first_id", first_id), form, address(packed), len(packed), 0)

    def set_masks(self, first_id: int, masks: ArrayLike) -> None:
        """Replaces the masks of instances of an array, with the ids first_id, first_id + 1, ...

        masks: as for `add_instances`.
        """
        own = masks_of(masks)
        lib.oc_scene_set_masks(self._h, whole("first_id", first_id), address(own), len(own), 0)

    def set_tints(self, first_id: int, tints: ArrayLike) -> None:
        """Replaces the tints of instances of an array, with the ids first_id, first_id + 1, ...

        tints: as for `add_instances`.
        """
        tinted = tints_of(tints)
        lib.oc_scene_set_tints(self._h, whole("first_id", first_id), address(tinted), len(tinted), 0)

    def remove_instances(self, first_id: int) -> None:
        """Removes all instances that one `add_instances` added, given by the first id."""
        lib.oc_scene_remove_instances(self._h, whole("first_id", first_id))

    def remove(self, id: int) -> None:
        """Removes an instance."""
        lib.oc_scene_remove_instance(self._h, whole("id", id))

    def set_transform(self, id: int, transform: ArrayLike | None) -> None:
        """Replaces the transform of an instance. See `add`."""
        lib.oc_scene_set_transform(self._h, whole("id", id), matrix("transform", transform))

    def set_mask(self, id: int, mask: int) -> None:
        """Sets the mask of an instance. A ray can hit it only if its mask has a common bit. Initially all are set."""
        lib.oc_scene_set_instance_mask(self._h, whole("id", id), whole("mask", mask, 32))

    def set_model(self, id: int, model: Model) -> None:
        """Exchanges the model of an instance, e.g. after it was built anew. Parts keep their looks, by id."""
        lib.oc_scene_set_model(self._h, whole("id", id), model._h)

    def set_lights(self, lights: Iterable[Light]) -> None:
        """Replaces all lights. Without lights only the ambient light of the frame remains."""
        structs: list[Any] = [light._to_c() for light in lights]
        array = (_abi.oc_light * len(structs))(*structs)
        lib.oc_scene_set_lights(self._h, array, len(structs), 0)

    def set_background(self, background: Background | None) -> None:
        """Replaces the background. None: the initial grey one."""
        lib.oc_scene_set_background(self._h, None if background is None else c.byref(background._to_c()))

    def set_look(self, id: int, *, hidden: bool = False, selected: bool = False, colour: Vector | None = None) -> None:
        """Sets the look of an instance. Without arguments it looks as in the file."""
        lib.oc_scene_set_instance_look(self._h, whole("id", id), c.byref(_look(hidden, selected, colour)))

    def set_occurrence_look(self, occurrence: int, *, hidden: bool = False, selected: bool = False,
                            colour: Vector | None = None) -> None:
        """Sets the look of an instance in one place of the scene that it is in. Without arguments it is removed. For an
        instance that is in no other scene it is `set_look`.

        occurrence: as for `path`. Later commits keep the look as long as the ids on the way lead to an instance.
        """
        lib.oc_scene_set_occurrence_look(self._h, whole("occurrence", int(occurrence)),
                                         c.byref(_look(hidden, selected, colour)))

    def set_part_look(self, part: int, *, hidden: bool = False, selected: bool = False, colour: Vector | None = None,
                      instance: int = 1) -> None:
        """Sets the look of a part, given by id. Its child parts do not change. See `set_parts_look`."""
        lib.oc_scene_set_part_look(self._h, whole("instance", instance), whole("part", part),
                                   c.byref(_look(hidden, selected, colour)))

    def set_parts_look(self, parts: ArrayLike, *, hidden: bool = False, selected: bool = False,
                       colour: Vector | None = None, below: bool = False, instance: int = 1) -> None:
        """Sets the look of many parts of an instance. Without `hidden`, `selected` and `colour`: as in the file.

        parts: ids of parts; an array of uint64 is read in place.
        hidden: no ray hits the parts.
        colour: linear RGB or RGBA; alpha is the opacity. None: the parts' own.
        below: all parts below them are meant too.
        """
        chosen = ids("parts", parts)
        lib.oc_scene_set_parts_look(self._h, whole("instance", instance), address(chosen), len(chosen),
                                    PartsFlags.BELOW if below else 0, c.byref(_look(hidden, selected, colour)))

    def isolate(self, parts: ArrayLike, *, below: bool = False, instance: int = 1) -> None:
        """Hides all parts of an instance but these, and shows these. Colours and highlights do not change."""
        chosen = ids("parts", parts)
        lib.oc_scene_isolate(self._h, whole("instance", instance), address(chosen), len(chosen),
                             PartsFlags.BELOW if below else 0)

    def fit(self, fit: Fit, parts: ArrayLike | Array | None = None, instance: int = 1) -> Camera:
        """Returns the camera that shows the visible parts, or chosen ones, as large as the picture allows.

        fit: the picture and the view, e.g. `Fit(width=1024, height=768, view=View.FRONT)`.
        parts: ids of parts of `instance`, or an array of dtype OVERLAP, as `overlap_frustum` returns it. None or empty:
            all parts of the scene.

        Raises:
            StateError: none of the parts is visible and has triangles.
        """
        chosen: Array
        if isinstance(parts, numpy.ndarray) and parts.dtype == OVERLAP:
            chosen = numpy.ascontiguousarray(parts)
        else:
            listed = ids("parts", [] if parts is None else parts)
            chosen = numpy.empty(len(listed), OVERLAP)
            chosen["instance"], chosen["part"] = whole("instance", instance), listed
        camera = _abi.oc_camera()
        lib.oc_scene_fit(self._h, c.byref(fit._to_c()), address(chosen), len(chosen), OVERLAP.itemsize,
                         c.byref(camera))
        return Camera._from_c(camera)

    def clear_part_looks(self, instance: int = 1) -> None:
        """Shows all parts of an instance as in the file."""
        lib.oc_scene_clear_part_looks(self._h, whole("instance", instance))


def _look(hidden: bool, selected: bool, colour: Vector | None) -> _abi.oc_look:
    """Returns the struct of a look."""
    flags = (LookFlags.HIDDEN if hidden else 0) | (LookFlags.SELECTED if selected else 0)
    look = _abi.oc_look(flags=flags)
    if colour is not None:
        rgba = [*colour, 1.0] if len(colour) == 3 else list(colour)
        look.flags |= LookFlags.COLOURED
        look.colour = numbers("colour", rgba, c.c_float, 4)
    return look
