"""The shell of a report's page: one self-contained file, without scripts, light or dark as the reader's system is."""

from html import escape

CSS = """
:root{color-scheme:light dark;--bg:#f6f7f9;--card:#fff;--ink:#1b1f24;--quiet:#5f6b7a;--line:#dde2e8;--grid:#e8ecf0;
--ok:#1a7f37;--warn:#9a6700;--bad:#cf222e;--okbg:#dafbe1;--warnbg:#fff3c4;--badbg:#ffe3e0;--quietbg:#e9edf1;
--c1:#0969da;--c2:#bf5700;--c3:#8250df;--measured:#2da44e;--interpolated:#e3a008;--none:#d1454f}
@media(prefers-color-scheme:dark){:root{--bg:#0f1318;--card:#171c23;--ink:#e4e9ef;--quiet:#95a1b0;--line:#2b333d;
--grid:#242b34;--ok:#56d27c;--warn:#e3b341;--bad:#ff7b72;--okbg:#12331d;--warnbg:#3a2d08;--badbg:#471a1a;
--quietbg:#252c35;--c1:#58a6ff;--c2:#f0883e;--c3:#bc8cff;--measured:#2ea556;--interpolated:#c98f0a;--none:#c8404a}}
*{box-sizing:border-box}
body{margin:0;background:var(--bg);color:var(--ink);font:15px/1.45 system-ui,-apple-system,"Segoe UI",Roboto,sans-serif}
main{max-width:1440px;margin:0 auto;padding:16px}
h1{font-size:1.5rem;margin:.4em 0 .1em;overflow-wrap:anywhere}
h2{font-size:1.15rem;margin:1.8em 0 .6em}
h3{font-size:1rem;margin:0 0 .4em;overflow-wrap:anywhere}
h4{font-size:.85rem;margin:0 0 .35em;font-weight:600}
h4 small{color:var(--quiet);font-weight:400}
p{margin:.3em 0}
a{color:var(--c1)}
.quiet{color:var(--quiet)}
.card{background:var(--card);border:1px solid var(--line);border-radius:10px;padding:14px;margin:0 0 14px}
.tiles{display:grid;grid-template-columns:repeat(auto-fit,minmax(128px,1fr));gap:10px;margin:14px 0}
.tile{background:var(--card);border:1px solid var(--line);border-radius:10px;padding:10px 12px}
.tile b{display:block;font-size:1.3rem;font-variant-numeric:tabular-nums;overflow-wrap:anywhere}
.tile span{color:var(--quiet);font-size:.82rem}
.scroll{overflow-x:auto;background:var(--card);border:1px solid var(--line);border-radius:10px}
table{border-collapse:collapse;width:100%;font-size:.88rem;font-variant-numeric:tabular-nums}
th,td{padding:7px 9px;text-align:left;border-bottom:1px solid var(--line);vertical-align:top}
th{color:var(--quiet);font-weight:600;white-space:nowrap}
tr:last-child td{border-bottom:0}
td.n,th.n{text-align:right;white-space:nowrap;width:1%}
td.name{min-width:10em;max-width:22em;overflow-wrap:anywhere}
td.why{min-width:16em;overflow-wrap:anywhere}
.pill{display:inline-block;padding:1px 9px;border-radius:99px;font-size:.8rem;
background:var(--quietbg);color:var(--quiet)}
.pill.ok{background:var(--okbg);color:var(--ok)}
.pill.degraded{background:var(--warnbg);color:var(--warn)}
.pill.failed{background:var(--badbg);color:var(--bad)}
dl{display:grid;grid-template-columns:minmax(8em,max-content) 1fr;gap:3px 14px;margin:0;font-size:.9rem}
dt{color:var(--quiet)}
dd{margin:0;overflow-wrap:anywhere}
.plots{display:grid;grid-template-columns:repeat(auto-fit,minmax(min(100%,430px),1fr));gap:18px 26px}
.plot{min-width:0}
.plot.wide{grid-column:1/-1}
.area{position:relative;height:130px;margin-left:52px}
.area.low{height:22px}
.area svg{position:absolute;inset:0;width:100%;height:100%;overflow:visible}
.yt{position:absolute;right:100%;transform:translateY(-50%);padding-right:7px;font-size:11px;color:var(--quiet);
white-space:nowrap}
.xt{position:relative;height:18px;margin-left:52px;font-size:11px;color:var(--quiet)}
.xt span{position:absolute;top:3px;transform:translateX(-50%)}
.xt b{position:absolute;top:3px;right:100%;padding-right:7px;font-weight:400}
path{fill:none;vector-effect:non-scaling-stroke}
.grid{stroke:var(--grid);stroke-width:1}
.curve{stroke-width:1.6;stroke-linecap:round;stroke-linejoin:round}
.c1{stroke:var(--c1)}.c2{stroke:var(--c2)}.c3{stroke:var(--c3)}
rect.s-measured{fill:var(--measured)}rect.s-interpolated{fill:var(--interpolated)}rect.s-none{fill:var(--none)}
.strip{display:block;width:100%;min-width:110px;height:14px;border-radius:3px}
.legend{font-weight:400;color:var(--quiet);margin-left:.8em}
.legend i{display:inline-block;width:10px;height:10px;border-radius:2px;margin:0 4px 0 6px}
i.s-measured{background:var(--measured)}i.s-interpolated{background:var(--interpolated)}i.s-none{background:var(--none)}
i.k-c1{background:var(--c1)}i.k-c2{background:var(--c2)}i.k-c3{background:var(--c3)}
.pictures{display:grid;grid-template-columns:repeat(auto-fill,minmax(min(100%,300px),1fr));gap:12px}
.pictures.small{grid-template-columns:repeat(auto-fill,minmax(min(100%,220px),1fr))}
.pictures.wide{grid-template-columns:repeat(auto-fit,minmax(min(100%,460px),1fr))}
figure{margin:0}
figure img,figure video{display:block;width:100%;height:auto;border-radius:6px}
figcaption{font-size:.8rem;color:var(--quiet);padding:4px 2px 0;overflow-wrap:anywhere}
details summary{cursor:pointer}
ul{margin:.3em 0;padding-left:1.2em}
li{overflow-wrap:anywhere}
@media(max-width:560px){main{padding:10px}dl{grid-template-columns:1fr;gap:0}dd{margin-bottom:5px}}
@media print{body{background:#fff}.card,.tile,.scroll{break-inside:avoid}}
"""

POLICY = "default-src 'none'; img-src data:; style-src 'unsafe-inline'"
"""What the page may load: nothing but what stands in it, whatever a file name tries."""
VIDEO_POLICY = f"{POLICY}; media-src 'self' file:"
"""Of a page that also plays videos that lie beside it."""


def page(title: str, body: str, policy: str = POLICY) -> str:
    """A whole page of the given HTML; the title is escaped here."""
    return (
        '<!doctype html>\n<html lang="en">\n<head>\n<meta charset="utf-8">\n'
        f'<meta http-equiv="Content-Security-Policy" content="{policy}">\n'
        '<meta name="viewport" content="width=device-width, initial-scale=1">\n'
        f"<title>{escape(title)}</title>\n<style>{CSS}</style>\n</head>\n<body>\n<main>\n{body}\n</main>\n</body>\n"
        "</html>\n"
    )
