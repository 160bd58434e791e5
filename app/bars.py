"""Bars: figures with a limit, as `eval` and `bench` report and print them (DESIGN 4)."""

from typing import Any


def at_least(name: str, value: float, limit: float) -> dict[str, Any]:
    return {"name": name, "value": round(value, 3), "bar": f">= {limit}", "ok": value >= limit}


def at_most(name: str, value: float, limit: float) -> dict[str, Any]:
    return {"name": name, "value": round(value, 3), "bar": f"<= {limit}", "ok": value <= limit}


def finish(bars: list[dict[str, Any]]) -> None:
    """Print the bars as a table; exit with status 1 if one fails."""
    from rich.console import Console
    from rich.table import Table

    table = Table("figure", "value", "bar", "")
    for bar in bars:
        table.add_row(
            bar["name"], f"{bar['value']:.3f}", bar["bar"], "ok" if bar["ok"] else "FAILED"
        )
    Console().print(table)
    if not all(bar["ok"] for bar in bars):
        raise SystemExit(1)
