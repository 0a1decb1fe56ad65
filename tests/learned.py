"""A type that tests share."""

from srlrepro.region.safe_region import SafeRegion
from srlrepro.samplers import TrainingData

Learned = tuple[TrainingData, SafeRegion]
