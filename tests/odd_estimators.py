"""Estimators that go wrong, each in its own way, and one that does not; workers import them by name."""

from __future__ import annotations

import ctypes
import os
import signal
import sys
import threading
import time
from dataclasses import dataclass

import torch

from bodyimage_kin.estimators import ConstantJacobian, Estimator, LeastSquares


@dataclass(frozen=True)
class Odd(Estimator):
    """Goes wrong as it is told."""

    way: str = "raises"

    def fit(self, exp, seed=0):
        if self.way == "raises":
            raise ValueError("nothing to\nlearn")
        if self.way == "sleeps":
            time.sleep(600)
        if self.way == "dies":
            os._exit(3)
        if self.way == "exits":
            sys.exit(3)
        if self.way == "interrupts":
            raise KeyboardInterrupt
        if self.way == "kills itself":
            os.kill(os.getpid(), signal.SIGKILL)
        if self.way == "aborts":
            os.abort()
        if self.way == "segfaults":
            ctypes.string_at(0)
        if self.way == "stops":
            os.kill(os.getpid(), signal.SIGSTOP)
        if self.way == "asks":
            input()
        if self.way == "dies later":
            threading.Thread(target=lambda: (time.sleep(0.5), os._exit(5)), daemon=True).start()
            return LeastSquares().fit(exp, seed)
        if self.way == "dawdles":
            time.sleep(1.5)
            return LeastSquares().fit(exp, seed)
        if self.way == "raises late":
            return Late()
        if self.way == "spins":
            while True:
                pass
        if self.way == "recurses":
            self.fit(exp, seed)
        if self.way == "shouts":
            raise ValueError("\0\ud800" + "é" * 5_000_000)
        if self.way == "cannot be said":
            raise Unsayable
        if self.way == "forgets":
            return None
        if self.way == "closes all":
            os.closerange(3, 100)
        if self.way == "floods":
            print("x" * 5_000_000)
        if self.way == "starts threads":
            threading.Thread(target=time.sleep, args=(600,)).start()
        if self.way == "guesses":
            return ConstantJacobian(torch.rand(2, 5, dtype=torch.float64))
        if self.way == "peeks":
            told = [name for name in (*exp.variables, *exp.attrs, *exp.dims) if "true" in str(name)]
            assert not told, told
            return LeastSquares().fit(exp, seed)
        if self.way == "leaks":
            return Lambda(lambda q, dq: torch.zeros(len(q), 2))
        matrix = LeastSquares().fit(exp, seed).matrix
        wrong = {
            "nan": torch.full_like(matrix, torch.nan),
            "inf": torch.full_like(matrix, torch.inf),
            "shape": matrix[:1],
        }
        return ConstantJacobian(wrong[self.way])


class Unsayable(Exception):
    """Has no words and cannot travel."""

    def __init__(self):
        self.lock = threading.Lock()

    def __str__(self):
        raise RuntimeError


class Late:
    """Fails only when it is asked."""

    def displacement(self, q, dq):
        raise ValueError("asked too much")

    jacobian = displacement


class Lambda:
    """Answers that are no tensors of float64."""

    def __init__(self, displacement):
        self.displacement = displacement

    def jacobian(self, q):
        return "a text"


class Plain:
    """No subclass of ours, and no dataclass: all that is asked for is ``fit``."""

    def __init__(self, scale=1.0):
        self.scale = scale

    def fit(self, exp, seed=0):
        return LeastSquares(scale=self.scale).fit(exp, seed)


class Seer:
    """Knows the true displacement of the hand image, however long the step: integrated, it is direct sight."""

    def __init__(self, body):
        self.body = body

    def fit(self, exp, seed=0):
        return self

    def displacement(self, q, dq):
        return self.body.hand_image(q + dq) - self.body.hand_image(q)

    def jacobian(self, q):
        return self.body.hand_image_jacobian(q)


class Explosive:
    """Finite in every answer, but not in their sum."""

    def fit(self, exp, seed=0):
        return self

    def displacement(self, q, dq):
        return torch.full((len(q), 2), 1e308, dtype=torch.float64)

    def jacobian(self, q):
        return torch.zeros(len(q), 2, q.shape[-1], dtype=torch.float64)


class Lost(Explosive):
    """Sound on the short tour, and nowhere else."""

    def displacement(self, q, dq):
        return torch.full((len(q), 2), 0.0 if len(q) < 150 else float("nan"), dtype=torch.float64)
