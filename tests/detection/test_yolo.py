"""The ONNX adapter, on a tiny network whose detections can be told from the image."""

import sys

import numpy as np
import onnx
import pytest
from onnx import TensorProto, helper
from tiny_yolo import make_network

from spin_rl.config import ConfigError
from spin_rl.deploy.kinematics import Frame
from spin_rl.detection.deproject import Intrinsics, locate
from spin_rl.detection.interface import best_of
from spin_rl.detection.yolo import YoloDetector
from spin_rl.detection.yolo_boxes import letterbox, suppress

RED, GREEN = (255, 0, 0), (0, 255, 0)


def picture(shape, *squares) -> np.ndarray:
    """Black, with coloured rectangles (colour, top, bottom, left, right)."""
    image = np.zeros((*shape, 3), dtype=np.uint8)
    for colour, top, bottom, left, right in squares:
        image[top:bottom, left:right] = colour
    return image


def detect(detector, image):
    return detector(image, np.zeros(image.shape[:2]))


@pytest.mark.parametrize("layout, certainty", [("v8", 1.0), ("v5", 0.8)])
@pytest.mark.parametrize("half", [False, True])
def test_finds_what_is_painted(tmp_path, layout, certainty, half):
    """The image has the input's size: cells are found as they are painted."""
    detector = YoloDetector(make_network(tmp_path / "tiny.onnx", layout, half=half))
    assert detector.labels == ("red", "green") and detector.input_shape == (96, 96)
    found = detect(detector, picture((96, 96), (RED, 16, 24, 40, 48), ((0, 128, 0), 80, 88, 0, 8)))
    assert [(d.label, d.box) for d in found] == [("red", (16, 24, 40, 48)), ("green", (80, 88, 0, 8))]
    np.testing.assert_allclose([d.score for d in found], [certainty, certainty * 128 / 255], rtol=1e-3)
    assert found[0].pixel == (19.5, 43.5)


@pytest.mark.parametrize(
    "shape, square, expected",
    [
        # Twice as wide as high: half as large in the input, 24 rows down.
        ((96, 192), (RED, 32, 48, 64, 80), (32, 48, 64, 80)),
        # A portrait image: half as large, 24 columns to the right.
        ((192, 96), (RED, 160, 176, 80, 96), (160, 176, 80, 96)),
        # Smaller than the input: twice as large.
        ((48, 48), (RED, 12, 16, 40, 44), (12, 16, 40, 44)),
    ],
)
@pytest.mark.parametrize("layout", ["v8", "v5"])
def test_boxes_are_those_of_the_image(tmp_path, layout, shape, square, expected):
    detector = YoloDetector(make_network(tmp_path / "tiny.onnx", layout), min_score=0.5)
    best = best_of(detect(detector, picture(shape, square)), "red")
    assert best is not None
    np.testing.assert_allclose(best.box, expected, atol=1e-4)


def test_input_that_is_not_square(tmp_path):
    detector = YoloDetector(make_network(tmp_path / "tiny.onnx", size=(64, 96)))
    assert detector.input_shape == (64, 96)
    (found,) = detect(detector, picture((128, 192), (GREEN, 96, 112, 160, 176)))
    assert found.label == "green"
    np.testing.assert_allclose(found.box, (96, 112, 160, 176), atol=1e-4)


def test_open_input_shape(tmp_path):
    path = make_network(tmp_path / "tiny.onnx", size=(64, 96), free=True)
    detector = YoloDetector(path, input_shape=(64, 96))
    assert detector.input_shape == (64, 96)
    assert detect(detector, picture((64, 96), (RED, 0, 8, 0, 8)))[0].box == (0, 8, 0, 8)
    with pytest.raises(ConfigError, match=r"tiny.onnx: "):
        YoloDetector(path, input_shape=(96, 96))


def test_threshold(tmp_path):
    image = picture((96, 96), ((100, 0, 0), 0, 8, 0, 8))
    path = make_network(tmp_path / "tiny.onnx")
    assert len(detect(YoloDetector(path, min_score=0.39), image)) == 1
    assert not detect(YoloDetector(path, min_score=0.4), image)


def test_from_image_to_point(tmp_path):
    """Through detector, depth and pose: a red square 1 m ahead, 0.2 m to the right, 0.1 m up."""
    camera = Intrinsics.from_fov((96, 96), (0.6, 0.6))
    pose = Frame(np.array([0.0, 0.0, 1.0]), np.array([[0.0, 0, 1], [0, 1, 0], [-1, 0, 0]]))
    row, column = (round(value - 0.5) for value in camera.project(np.array([-0.1, -0.2, 1.0])) + 0.5)
    top, left = row // 8 * 8, column // 8 * 8
    image = picture((96, 96), (RED, top, top + 8, left, left + 8))
    depth = np.where(image[..., 0] > 0, 1.0, 3.0)
    (found,) = YoloDetector(make_network(tmp_path / "tiny.onnx"))(image, depth)
    point = locate(found, depth, camera, pose)
    np.testing.assert_allclose(point, [1.0, -0.2, 1.1], atol=8 * 0.6 * 2 / 96)


def test_labels_given_by_the_user(tmp_path):
    path = make_network(tmp_path / "tiny.onnx", names=None)
    detector = YoloDetector(path, labels=("can", "mug"))
    assert detect(detector, picture((96, 96), (GREEN, 0, 8, 0, 8)))[0].label == "mug"
    listed = make_network(tmp_path / "listed.onnx", names=["can", "mug"])
    assert YoloDetector(listed).labels == ("can", "mug")


def test_suppression_is_by_label():
    """By hand: overlaps of 0.6 and 1/3 with the first, and one of another label."""
    boxes = np.array(
        [[0, 10, 0, 8], [0, 10, 2, 10], [0, 10, 4, 12], [0, 10, 0, 8], [50, 60, 0, 8]], dtype=float
    )
    scores = np.array([0.9, 0.8, 0.7, 0.95, 0.1])
    labels = np.array([0, 0, 0, 1, 0])
    assert suppress(boxes, scores, labels, 0.59) == [3, 0, 2, 4]
    assert suppress(boxes, scores, labels, 0.61) == [3, 0, 1, 2, 4]
    assert suppress(boxes, scores, labels, 0.3) == [3, 0, 4]
    assert suppress(boxes[:0], scores[:0], labels[:0], 0.5) == []


def test_letterbox():
    """Grey beside the image, and in it what linear interpolation gives: a ramp stays a ramp."""
    ramp = np.repeat(np.arange(0, 200, 10, dtype=np.uint8)[None, :, None], 10, axis=0).repeat(3, axis=2)
    tensor, placed = letterbox(ramp, (40, 40))
    assert tensor.shape == (1, 3, 40, 40) and placed.shift == (10, 0) and placed.scale == 2.0
    np.testing.assert_allclose(tensor[:, :, [0, 9, 30, 39]], 114 / 255, rtol=1e-6)
    inside = np.clip((np.arange(40) + 0.5) / 2 - 0.5, 0, 19) * 10 / 255
    np.testing.assert_allclose(tensor[0, 1, 20], inside, atol=1e-6)


def identity(path, kind, shape) -> str:
    """A model whose output is its input."""
    values = [helper.make_tensor_value_info(name, kind, shape) for name in ("images", "output0")]
    graph = helper.make_graph(
        [helper.make_node("Identity", ["images"], ["output0"])], "g", values[:1], values[1:]
    )
    model = helper.make_model(graph, opset_imports=[helper.make_opsetid("", 17)], ir_version=9)
    onnx.save(model, str(path))
    return str(path)


def assert_one_line(error: pytest.ExceptionInfo) -> None:
    assert "\n" not in str(error.value)


@pytest.mark.parametrize(
    "options, message",
    [
        (
            {"labels": ["a", "b", "c"]},
            r"output has shape \[1, 6, 144\]; with 3 labels it must be \[1, 7, n\]",
        ),
        ({"labels": []}, "labels"),
        ({"labels": ["a", "a"]}, "all different"),
        ({"min_score": 1.5}, "min_score"),
        ({"max_overlap": 0.0}, "max_overlap"),
        ({"providers": ["NoSuchProvider"]}, "choose from .*CPUExecutionProvider"),
    ],
)
def test_rejects_options(tmp_path, options, message):
    path = make_network(tmp_path / "tiny.onnx")
    with pytest.raises(ConfigError, match=message) as error:
        YoloDetector(path, **options)
    assert_one_line(error)


@pytest.mark.parametrize(
    "make, message",
    [
        (lambda p: p, "no such file"),
        (lambda p: p.write_bytes(b"not a model") and p, "cannot load it"),
        (lambda p: make_network(p, names=None), "labels: the file has none"),
        (lambda p: make_network(p, names="{0: 'red', 5: 'green'}"), "labels: cannot read"),
        (lambda p: make_network(p, names="import os"), "labels: cannot read"),
        (lambda p: identity(p, TensorProto.FLOAT, [1, 3, 8]), r"needs one input of floats \[1, 3, rows"),
        (lambda p: identity(p, TensorProto.FLOAT, [1, 1, 8, 8]), "needs one input of floats"),
        (lambda p: identity(p, TensorProto.FLOAT, [2, 3, 8, 8]), "needs one input of floats"),
        (lambda p: identity(p, TensorProto.UINT8, [1, 3, 8, 8]), "needs one input of floats"),
    ],
)
def test_rejects_models(tmp_path, make, message):
    with pytest.raises(ConfigError, match=message) as error:
        YoloDetector(make(tmp_path / "bad.onnx"))
    assert "bad.onnx: " in str(error.value)
    assert_one_line(error)


def test_output_that_is_no_yolo(tmp_path):
    path = identity(tmp_path / "same.onnx", TensorProto.FLOAT, [1, 3, 8, 8])
    with pytest.raises(ConfigError, match=r"same.onnx: the output has shape \[1, 3, 8, 8\]") as error:
        YoloDetector(path, labels=["can"])
    assert_one_line(error)


def test_without_onnxruntime(tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "onnxruntime", None)
    with pytest.raises(ConfigError, match=r"pip install 'spin-rl\[detect\]'") as error:
        YoloDetector(tmp_path / "tiny.onnx")
    assert_one_line(error)


@pytest.mark.parametrize(
    "image", [np.zeros((8, 8), np.uint8), np.zeros((8, 8, 3)), np.zeros((8, 8, 4), np.uint8)]
)
def test_rejects_images(tmp_path, image):
    detector = YoloDetector(make_network(tmp_path / "tiny.onnx"))
    with pytest.raises(ValueError, match="image must be"):
        detect(detector, image)
