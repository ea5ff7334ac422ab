"""The lineage of artifacts as a page that needs nothing beside itself: a drawing, and what each box of it stands for.

Whoever shows it may allow neither other files nor links to other pages, as MLflow does.
"""

from __future__ import annotations

from collections.abc import Mapping
from html import escape

from juicer.artifacts.manifest import Manifest
from juicer.artifacts.ref import ArtifactRef
from juicer.reporting.lineage import Manifests, nodes_of
from juicer.reporting.lineage_drawing import Boxes, lineage_graph

_STYLE = """
body { margin: 16px; font: 14px/1.5 system-ui, sans-serif; color: #1d2733; background: #fff; }
.lineage { display: block; width: 100%; height: auto; font-size: 11.5px; }
.edge { fill: none; stroke: #7b8794; stroke-width: 1.2; opacity: 0.6; }
.node rect { fill: #f8fafc; stroke: #7b8794; stroke-width: 1.2; }
.node text { fill: #1d2733; } .node .id { fill: #5f6b78; font-size: 10.5px; }
.node.episodes rect { stroke: #b45309; } .node.checkpoint rect { stroke: #1d4ed8; stroke-width: 2; }
.node.evaluation rect { stroke: #15803d; stroke-width: 2; }
a:hover .node rect, a:focus .node rect { fill: #fef3c7; }
.scroll { overflow-x: auto; }
table { border-collapse: collapse; margin-top: 16px; } th { text-align: left; }
td, th { border-bottom: 1px solid #d9dfe5; padding: 4px 12px 4px 0; vertical-align: top; }
td:first-child { white-space: nowrap; } tr.chosen { background: #fef3c7; } code { font-size: 12px; }
"""
# Where MLflow shows the page, the browser does not even follow links within it.
_SCRIPT = """
addEventListener("click", (event) => {
  const link = event.target.closest("a");
  if (!link) return;
  event.preventDefault();
  document.querySelector(".chosen")?.classList.remove("chosen");
  const row = document.getElementById(link.getAttribute("href").slice(1));
  row.classList.add("chosen");
  row.scrollIntoView({ block: "center" });
});
"""


def lineage_page(title: str, manifests: Manifests, names: Mapping[ArtifactRef, str]) -> str:
    """The page.

    Args:
        title: Headline.
        manifests: The artifacts.
        names: What some of them are called, instead of by what they hold.
    """
    nodes = [*nodes_of(manifests, names)]
    rows = "".join(
        f'<tr id="{node.id}"><td><b>{escape(node.label)}</b><br><code>{node.id}</code></td>'
        f"<td>{_facts(manifest)}</td><td>{'<br>'.join(_link(parent) for parent in node.parents)}</td></tr>"
        for node, manifest in zip(nodes, manifests.values(), strict=True)
    )
    drawing = lineage_graph(nodes, Boxes(link=lambda node: f"#{node.id}"))
    return (
        f'<!doctype html><html lang="en"><meta charset="utf-8"><title>{escape(title)}</title><style>{_STYLE}</style>'
        f"<h1>{escape(title)}</h1><p>Click a box for its facts; <code>juicer show ID</code> tells all.</p>"
        f'<div class="scroll">{drawing}</div>'
        f"<table><tr><th>artifact<th>facts<th>made from</tr>{rows}</table><script>{_SCRIPT}</script></html>"
    )


def _link(node: str) -> str:
    return f'<a href="#{node}"><code>{node}</code></a>'


def _facts(manifest: Manifest | None) -> str:
    if manifest is None:
        return "no longer there"
    facts = {"stage": manifest.recipe.stage, "seconds": round(manifest.seconds, 1), **manifest.summary}
    shown = (
        (key, f"{fact:.4g}" if isinstance(fact, float) else str(fact))
        for key, fact in facts.items()
        if isinstance(fact, str | int | float)
    )
    return "<br>".join(f"{escape(key)}: {escape(fact)}" for key, fact in shown)
