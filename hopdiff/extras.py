import os


def enter() -> None:
    os.chdir(os.environ["HOPDIFF_FOLDER"])
