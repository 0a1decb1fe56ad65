"""A type that tests share."""

from srlrepro.safe_region import SafeRegion
from srlrepro.sampling import TrainingData

Learned = tuple[TrainingData, SafeRegion]
