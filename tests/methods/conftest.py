"""One torch thread: the networks here are so small that a second one makes them many times slower."""

import torch

torch.set_num_threads(1)
