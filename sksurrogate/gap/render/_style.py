"""The style sheet of the page: light, dark and printed."""

_LIGHT = (
    "--ink:#111;--soft:#555;--rule:#ccc;--paper:#fff;--card:#f6f7f8;--measured:#8f8f8f;--before:#d55e00;--accent:#0072b2;"
    "--second:#009e73;--third:#aa4499;--band:#dedede;--grid:#eee;--good:#1a7f37;--warn:#9a6700;--bad:#b3261e"
)
_DARK = (
    "--ink:#eaeaea;--soft:#a8adb3;--rule:#454a50;--paper:#15181b;--card:#1f2327;--measured:#8b9096;--before:#ff9248;"
    "--accent:#6cb8f0;--second:#4fd1a5;--third:#e08fd6;--band:#363b41;--grid:#272b30;--good:#57c878;--warn:#e0b252;--bad:#ff8a80"
)

# Everything hangs below .skgap, so that a notebook keeps its own look.
_BASE = """
.skgap{%LIGHT%;font:16px/1.5 system-ui,sans-serif;max-width:60em;margin:0 auto;padding:1em 1.2em 2em;color:var(--ink);
background:var(--paper);overflow-wrap:anywhere;color-scheme:light dark}
.skgap .eyebrow{color:var(--soft);margin:0}.skgap h1{font-size:1.55em;line-height:1.28;margin:.35em 0 .5em;font-weight:600}
.skgap .word{display:inline-block;padding:.05em .5em;border-radius:.3em;border:2px solid currentColor;margin-right:.35em;
font-size:.75em;vertical-align:.12em}
.skgap .explained{color:var(--good)}.skgap .none{color:var(--good)}.skgap .partial{color:var(--warn)}
.skgap .unknown{color:var(--bad)}
.skgap h2{font-size:1.15em;margin:2.2em 0 .6em;padding-bottom:.2em;border-bottom:1px solid var(--rule)}
.skgap h3{font-size:1em;margin:1.2em 0 .3em}.skgap p{margin:.4em 0}
.skgap .change{font-size:1.1em;font-variant-numeric:tabular-nums;margin:.2em 0}
.skgap .steps{padding-left:1.3em;margin:.3em 0}.skgap .steps li{margin:.2em 0}
.skgap .card{background:var(--card);border-radius:.5em;padding:.7em 1em;margin:.8em 0}
.skgap .grid{display:grid;grid-template-columns:repeat(auto-fill,minmax(17.5em,1fr));gap:.9em}
.skgap .grid figure{margin:0}
.skgap .scroll{overflow-x:auto}.skgap table{border-collapse:collapse;font-size:.9em}
.skgap th,.skgap td{padding:.22em .9em .22em 0;border-bottom:1px solid var(--rule);text-align:left;vertical-align:top;
overflow-wrap:normal;white-space:nowrap}
.skgap td.wrap{white-space:normal;min-width:12em}
.skgap th.n,.skgap td.n{text-align:right;font-variant-numeric:tabular-nums}.skgap tr.named td{font-weight:700}
.skgap figure{margin:1em 0}.skgap svg{width:100%;height:auto;overflow:hidden}
.skgap svg.field{width:auto;max-width:none}.skgap svg text{font-family:system-ui,sans-serif;fill:var(--ink)}
.skgap svg polyline,.skgap svg path{fill:none;stroke:var(--ink);stroke-linejoin:round;vector-effect:non-scaling-stroke}
.skgap svg .measured{stroke:var(--measured)}.skgap svg .before{stroke:var(--before)}.skgap svg .accent{stroke:var(--accent)}
.skgap svg .second{stroke:var(--second)}.skgap svg .third{stroke:var(--third)}
.skgap svg .band{fill:var(--band);stroke:none}.skgap svg .frame{fill:none;stroke:var(--soft)}
.skgap svg .gl{stroke:var(--grid)}.skgap svg .cursor{stroke:var(--soft);stroke-dasharray:3 3}
.skgap svg.plot{touch-action:pan-y;cursor:crosshair}
.skgap .tip{position:absolute;pointer-events:none;background:var(--paper);border:1px solid var(--soft);border-radius:.3em;
padding:.15em .5em;font-size:.8em;white-space:pre;font-variant-numeric:tabular-nums;z-index:9}
.skgap figcaption,.skgap .small{font-size:.88em;color:var(--soft)}
.skgap .bars{max-width:46em}.skgap .row{display:flex;gap:.5em;align-items:center;margin:.25em 0}
.skgap .name{flex:0 0 11em}.skgap .rail{flex:1 1 auto}.skgap .size{flex:0 0 6.2em;white-space:nowrap;font-variant-numeric:tabular-nums}
.skgap .bar{display:block;height:1.1em;background:var(--accent);border-right:2px solid var(--ink)}
.skgap .budget{margin:.8em 0}.skgap .budgetbar{display:flex;gap:2px;height:1.9em}.skgap .budgetbar span{min-width:2px}
.skgap .bar,.skgap .budgetbar span,.skgap .key{print-color-adjust:exact;-webkit-print-color-adjust:exact}
.skgap .budget ul{list-style:none;padding:0;margin:.4em 0;display:flex;flex-wrap:wrap;gap:.1em 1.4em}
.skgap .budget li{padding-left:1.3em;text-indent:-1.3em}
.skgap .key{display:inline-block;text-indent:0;width:.8em;height:.8em;margin-right:.45em;border:1px solid var(--ink)}
.skgap pre{background:var(--card);padding:.8em 1em;border-radius:.4em;overflow-x:auto;font-size:.86em;line-height:1.45}
.skgap details{margin:.6em 0}.skgap summary{cursor:pointer;color:var(--accent)}
.skgap dl{display:grid;grid-template-columns:auto 1fr;gap:.1em 1em;font-size:.9em;margin:.5em 0}.skgap dt{color:var(--soft)}
.skgap dd{margin:0}
@media(prefers-color-scheme:dark){.skgap{%DARK%}}
@media(max-width:30rem){.skgap{padding:.8em}.skgap .wide{overflow-x:auto}.skgap .wide svg.plot{min-width:42em}.skgap h1{font-size:1.25em}.skgap th,.skgap td{padding-right:.6em}
.skgap .name{flex-basis:7.5em;font-size:.85em}.skgap .size{flex-basis:3.6em;font-size:.85em}
.skgap .grid{grid-template-columns:1fr}}
@media print{.skgap{%LIGHT%;max-width:none;font-size:11px;padding:0}.skgap figure,.skgap tr,.skgap .card,.skgap .bars,
.skgap pre{break-inside:avoid}.skgap h2,.skgap h3{break-after:avoid}.skgap .scroll{overflow:visible}
.skgap td{white-space:normal}.skgap svg{max-width:32em}.skgap .wide svg{width:75%}.skgap .grid{grid-template-columns:1fr 1fr}
.skgap .noprint{display:none}.skgap pre{white-space:pre-wrap}}
@page{margin:14mm}
"""

STYLE = _BASE.replace("%LIGHT%", _LIGHT).replace("%DARK%", _DARK)
