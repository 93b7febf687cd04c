"""Actors and critics: encoders of scandots and depth, and two models on rsl_rl's interface."""

from spin_rl.models.depth_encoder import DepthEncoder, DepthEncoderConfig
from spin_rl.models.distribution import PerActionGaussian
from spin_rl.models.lstm import LSTMState, ResettableLSTM
from spin_rl.models.pointnet import NoPointNet, PointNet
from spin_rl.models.scandot import ScandotModel, ScandotRecurrentModel

__all__ = [
    "DepthEncoder",
    "DepthEncoderConfig",
    "LSTMState",
    "NoPointNet",
    "PerActionGaussian",
    "PointNet",
    "ResettableLSTM",
    "ScandotModel",
    "ScandotRecurrentModel",
]
