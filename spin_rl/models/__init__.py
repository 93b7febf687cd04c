"""Actors and critics: scandot encoders, a feed-forward and a recurrent model on rsl_rl's interface."""

from spin_rl.models.distribution import PerActionGaussian
from spin_rl.models.lstm import LSTMState, ResettableLSTM
from spin_rl.models.pointnet import NoPointNet, PointNet
from spin_rl.models.scandot import ScandotModel, ScandotRecurrentModel

__all__ = [
    "LSTMState",
    "NoPointNet",
    "PerActionGaussian",
    "PointNet",
    "ResettableLSTM",
    "ScandotModel",
    "ScandotRecurrentModel",
]
