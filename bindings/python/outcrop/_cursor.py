"""Cursors: the nodes of a model's trees, for programs that walk the trees by themselves."""

from __future__ import annotations

import ctypes as c
from typing import Any

import numpy
from numpy.typing import NDArray

from ._abi import OC_NO_ID
from ._arrays import NODE, NODE_TRIANGLE, TREE_PLACE, Array, address
from ._handles import Handle
from ._library import lib
from ._value import whole

_MOST_TRIANGLES = 64


class Cursor(Handle):
    """Reads the nodes of a model's trees, made by `Model.cursor`. A node has an id, which holds for the file."""

    _kind = "Cursor"
    _release = lib.oc_cursor_release

    def root(self, tree: int = 0) -> int | None:
        """Returns the id of the root of a tree, or None if the tree has no triangles."""
        node = c.c_uint64()
        lib.oc_cursor_root(self._h, whole("tree", tree, 32), c.byref(node))
        return None if node.value == OC_NO_ID else node.value

    @property
    def places(self) -> Array:
        """All trees, as they are placed in the model: an array of dtype TREE_PLACE."""
        count = c.c_uint64()
        lib.oc_cursor_places(self._h, None, 0, c.byref(count))
        found = numpy.empty(count.value, TREE_PLACE)
        lib.oc_cursor_places(self._h, address(found), len(found), c.byref(count))
        return found

    def node(self, node: int) -> Any:
        """Returns a node, given by id, with the ids and boxes of its children: an element of dtype NODE.

        Raises:
            ArgumentError: no node has the id.
            StateError: with `now`, the node is not in memory.
        """
        found = numpy.zeros(1, NODE)
        # The struct begins with its size.
        found.view(numpy.uint32)[0] = NODE.itemsize
        lib.oc_cursor_node(self._h, whole("node", node), address(found))
        return found[0]

    def triangles(self, node: int, *, prims: bool = True) -> NDArray[Any]:
        """Returns the triangles of a leaf, given by id, as an array of dtype NODE_TRIANGLE.

        prims: read the indices of the triangles in the input of the build too.

        Raises:
            ArgumentError: no leaf has the id.
            StateError: with `now`, the triangles are not in memory.
        """
        found = numpy.empty(_MOST_TRIANGLES, NODE_TRIANGLE)
        count = c.c_uint64()
        lib.oc_cursor_triangles(self._h, whole("node", node), bool(prims), address(found), len(found), c.byref(count))
        return found[:count.value]

    def block_nodes(self, block: int) -> NDArray[numpy.uint64]:
        """Returns the ids of all nodes of a block, below `blocks` of `Model.info`."""
        count = c.c_uint64()
        lib.oc_cursor_block_nodes(self._h, whole("block", block, 32), None, 0, c.byref(count))
        found = numpy.empty(count.value, numpy.uint64)
        lib.oc_cursor_block_nodes(self._h, block, address(found), len(found), c.byref(count))
        return found
