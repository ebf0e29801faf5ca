"""What the documentation says about GPUs is what was measured on one."""

from pathlib import Path

ROOT = Path(__file__).parents[2]


def test_the_page_says_whether_a_gpu_was_measured():
    page = (ROOT / "docs/how-to/gpu.md").read_text()
    assert ("Not yet run on a GPU" in page) != (ROOT / "benchmarks/gpu.json").exists()
