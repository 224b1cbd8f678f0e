"""What the searches walk on."""

import os

# NumPy's linear algebra reads this when it is loaded; with matrices this small its threads only cost time.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
