"""Searches: what each is called, and the class whose fields are its settings."""

from hopdiff.search.cmaes import CMAES
from hopdiff.search.ga import GA
from hopdiff.search.gradient import Gradient
from hopdiff.search.hybrid import Hybrid
from hopdiff.search.ordinary import Ordinary
from hopdiff.search.random import Random

SEARCHES: dict[str, type] = {
    "ga": GA,
    "gradient": Gradient,
    "hybrid": Hybrid,
    "cmaes": CMAES,
    "random": Random,
    "ordinary": Ordinary,
}
