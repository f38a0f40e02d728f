from .parameters import Observer as Observer
from .stability import gamma_bound_around as gamma_bound_around
