"""A network that detects red and green squares, in the layouts of YOLO-family exports, made with onnx.

The input is cut into cells of 8 x 8 pixels. A cell's box is the cell; its scores are the mean red without
green, and green without red. What is found can so be told from the image alone.
"""

import numpy as np
import onnx
from onnx import TensorProto, helper, numpy_helper

CELL = 8
NAMES = {0: "red", 1: "green"}


def make_network(path, layout="v8", size=(96, 96), names=NAMES, *, half=False, free=False):
    """Write the model.

    Args:
        path: ONNX file.
        layout: "v8", [1, 4 + 2, n], or "v5", [1, n, 5 + 2] whose score of being an object is 0.8.
        size: Rows and columns of the input.
        names: What to write into the file as labels, None for nothing.
        half: Input of 16-bit floats.
        free: Leave rows and columns of the input open; the cells are those of ``size`` all the same.
    """
    rows, columns = size[0] // CELL, size[1] // CELL
    y, x = np.meshgrid(np.arange(rows), np.arange(columns), indexing="ij")
    boxes = np.stack([(x + 0.5) * CELL, (y + 0.5) * CELL, np.full_like(x, CELL), np.full_like(x, CELL)])
    boxes = boxes.reshape(1, 4, -1).astype(np.float32)
    mix = np.array([[1, -1, 0], [-1, 1, 0]], dtype=np.float32).reshape(2, 3, 1, 1)
    constants = {
        "mix": mix,
        "boxes": boxes,
        "flat": np.array([1, 2, -1], dtype=np.int64),
    }
    nodes = [
        helper.make_node("Cast", ["images"], ["floats"], to=TensorProto.FLOAT),
        helper.make_node(
            "AveragePool", ["floats"], ["means"], kernel_shape=[CELL, CELL], strides=[CELL, CELL]
        ),
        helper.make_node("Conv", ["means", "mix"], ["mixed"]),
        helper.make_node("Relu", ["mixed"], ["positive"]),
        helper.make_node("Reshape", ["positive", "flat"], ["scores"]),
    ]
    if layout == "v8":
        nodes.append(helper.make_node("Concat", ["boxes", "scores"], ["output0"], axis=1))
        shape = [1, 6, boxes.shape[2]]
    else:
        constants["object"] = np.full((1, 1, boxes.shape[2]), 0.8, dtype=np.float32)
        nodes.append(helper.make_node("Concat", ["boxes", "object", "scores"], ["columns"], axis=1))
        nodes.append(helper.make_node("Transpose", ["columns"], ["output0"], perm=[0, 2, 1]))
        shape = [1, boxes.shape[2], 7]
    kind = TensorProto.FLOAT16 if half else TensorProto.FLOAT
    image_shape = [1, 3, "height", "width"] if free else [1, 3, *size]
    graph = helper.make_graph(
        nodes,
        "tiny",
        [helper.make_tensor_value_info("images", kind, image_shape)],
        [helper.make_tensor_value_info("output0", TensorProto.FLOAT, shape)],
        [numpy_helper.from_array(value, name) for name, value in constants.items()],
    )
    model = helper.make_model(graph, opset_imports=[helper.make_opsetid("", 17)], ir_version=9)
    if names is not None:
        helper.set_model_props(model, {"names": str(names)})
    onnx.checker.check_model(model)
    onnx.save(model, str(path))
    return path
