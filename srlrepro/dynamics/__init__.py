"""The pendulum, its controller K(x), the labels of eq. (2), and the task (Sec. IV-A)."""

from srlrepro import pins

pins.warn()  # here, since everything that computes imports the pendulum
