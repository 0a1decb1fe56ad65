"""How fast the learner is (``python -m benchmarks``), on one thread, which is set before numpy starts.

The kernels are not pinned: that would slow the stock learner down, with which ours is compared.
"""

import os

from srlrepro.pins import THREADS

os.environ.update(THREADS)
