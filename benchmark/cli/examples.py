"""An example of each verb, which ``--help`` shows."""

from __future__ import annotations

#: Command lines by verb, without the name of the program.
EXAMPLES = {
    "run": "run -t III --quick -m gps -m classic-mds",
    "plan": "plan -d FOLDER -m gps",
    "tables": "tables -d FOLDER -o tables",
    "report": "report --quick",
    "compare": "compare mesh-unfolding classic-mds -t III --published",
    "list": "list methods",
    "describe": "describe mesh-unfolding",
    "canonicalise": "canonicalise -m gps cat.off -o form.off",
    "retrieve": "retrieve -m gps -d FOLDER new.off -k 3",
    "score": "score distances.csv --labels labels.txt",
    "check": "check my_method.py",
    "train": "train learned --data DIR --hold-out anna -o resolution=128",
    "merge": "merge RESULTS-OF-A-COLLEAGUE",
    "forget": "forget -m gps -d FOLDER",
    "demo": "demo cat.off",
    "data check": "data check FOLDER",
    "data export": "data export FOLDER -o DIR",
    "models fetch": "models fetch --from CHECKOUT/learned/models",
}


def example_of(path: str) -> str:
    """Return the example of a verb by its path, such as ``PROGRAM data check``; "" without one."""
    words = path.split()
    for start in range(len(words)):
        verb = " ".join(words[start:])
        if verb in EXAMPLES:
            return f"python -m benchmark {EXAMPLES[verb]}"
    return ""
