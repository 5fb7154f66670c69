"""The merged report: what became of every capture, and of all together, as JSON and as one HTML page."""
import html
import json
import math
import os
import urllib.parse

from plan import DONE, FAILED, INCOMPLETE, WAITING, written_whole

KINDS = ("crumpling", "friction", "tearing")
LOSSES = ("voices_dropped", "sources_dropped", "cues_dropped", "sounds_missing", "samples_not_finite")
SILENCE_DBFS = -299  # and below


def row_of(plan, number):
    """A capture's line of the report."""
    result = plan.result(number)
    row = {"number": number, "capture": plan.captures[number - 1], "state": result["state"], "reason": result["reason"]}
    if "render" in result:
        outputs = plan.outputs(number)
        row.update(sound=os.path.relpath(outputs["-o"], plan.out), event_list=os.path.relpath(outputs["--events"], plan.out))
        if plan.pages:
            row["page"] = os.path.relpath(outputs["--report"], plan.out)
        row.update(result["render"])
    row.update({name: result[name] for name in ("elapsed_s", "processor_s", "memory_mb", "host") if name in result})  # of the whole program
    return row


def percentile(in_order, share):
    """The least value that so many percent do not exceed."""
    return in_order[max(0, math.ceil(share / 100 * len(in_order)) - 1)]


def totals_of(rows):
    rendered = [row for row in rows if "seconds" in row]
    took = sorted(row["elapsed_s"] for row in rows if "elapsed_s" in row)
    sound_s = sum(row["seconds"] for row in rendered)
    power = sum(row["seconds"] * 10 ** (row["rms_dbfs"] / 10) for row in rendered)
    return {
        "captures": len(rows),
        **{state: sum(row["state"] == state for row in rows) for state in (DONE, INCOMPLETE, FAILED, WAITING)},
        "sound_s": sound_s,
        "events": {kind: sum(row["events"][kind] for row in rendered) for kind in KINDS},
        "peak_dbfs": max((row["peak_dbfs"] for row in rendered), default=-300),
        "rms_dbfs": 10 * math.log10(max(power / sound_s, 1e-30)) if sound_s > 0 else -300,
        "samples_limited": sum(row["samples_limited"] for row in rendered),
        "lost": sum(row[loss] for row in rendered for loss in LOSSES),
        "elapsed_s": sum(took),
        "processor_s": sum(row.get("processor_s", 0) for row in rows),
        "capture_s": {"median": percentile(took, 50), "p95": percentile(took, 95), "most": took[-1]} if took else None,
        "memory_mb_most": max((row.get("memory_mb", 0) for row in rows), default=0),
    }


def make_report(plan):
    """Writes report.json and report.html; returns what the first holds."""
    rows = [row_of(plan, number) for number in range(1, len(plan.captures) + 1)]
    report = {"captures_folder": plan.folder, "options": plan.options, "version": plan.version, "totals": totals_of(rows),
              "failures": [row for row in rows if row["state"] != DONE], "captures": rows}
    with written_whole(plan.out / "report.json") as file:
        json.dump(report, file, indent=1)
        file.write("\n")
    with written_whole(plan.out / "report.html") as file:
        file.write(page_of(report))
    return report


def counted(count, noun):
    return f"{count} {noun}{'' if count == 1 else 's'}"


def duration(seconds):
    if seconds < 100:
        return f"{seconds:.2f} s" if seconds < 10 else f"{seconds:.0f} s"
    minutes = round(seconds / 60)
    return f"{minutes} min" if minutes < 100 else f"{minutes // 60} h {minutes % 60:02} min"


def level(dbfs):
    return "silence" if dbfs < SILENCE_DBFS else f"{dbfs:.1f} dBFS"


def summary_lines(plan, totals):
    """The report in a few lines for a terminal."""
    events = totals["events"]
    parts = [f"{totals[state]} {word}" for state, word in ((DONE, "done"), (INCOMPLETE, "incomplete"), (FAILED, "failed"), (WAITING, "not rendered yet"))
             if totals[state] or state == DONE]
    yield f"{counted(totals['captures'], 'capture')}: {', '.join(parts)}"
    if totals["capture_s"]:
        yield (f"{duration(totals['sound_s'])} of sound: {events['crumpling']} crumpling, {events['friction']} friction, {events['tearing']} tearing; "
               f"peak {level(totals['peak_dbfs'])}, RMS {level(totals['rms_dbfs'])}")
        took = totals["capture_s"]
        yield (f"{duration(totals['processor_s'])} of a processor; a capture took {duration(took['median'])} (median), {duration(took['most'])} at most, and "
               f"{totals['memory_mb_most']:.0f} MB of memory at most")
    yield f"{plan.out / 'report.html'}, {plan.out / 'report.json'}"


STYLE = """
:root{--page:#f4f2ed;--card:#fff;--ink:#1d1f22;--muted:#62666d;--line:#dcd8cf;--good:#2f7d4f;--bad:#b3362b;--warn:#a86a00}
@media(prefers-color-scheme:dark){:root{--page:#0e1013;--card:#181b20;--ink:#e6e4df;--muted:#9a9ea6;--line:#30343b;--good:#6cc08b;--bad:#f0857a;--warn:#e0ac52}}
body{margin:0 auto;padding:24px;max-width:1300px;background:var(--page);color:var(--ink);font:15px/1.5 system-ui,"DejaVu Sans",sans-serif}
h1{font-size:1.5rem;margin:0}h2{font-size:1.1rem;margin:0 0 8px}p,.muted{color:var(--muted);overflow-wrap:anywhere}a{color:inherit}
ul{display:grid;grid-template-columns:repeat(auto-fill,minmax(160px,1fr));gap:10px;padding:0;list-style:none}
li,section{background:var(--card);border:1px solid var(--line);border-radius:8px;padding:10px 14px}section{margin:0 0 16px}
li b{display:block;font-size:1.4rem}li span{color:var(--muted);font-size:.86rem}
.scroll{overflow-x:auto}table{border-collapse:collapse;width:100%;font-size:.85rem;font-variant-numeric:tabular-nums}
th,td{padding:5px 7px;text-align:right;white-space:nowrap;border-bottom:1px solid var(--line)}th{color:var(--muted)}th button{all:unset;cursor:pointer}
th button:focus-visible{outline:2px solid}.left{text-align:left}.wide{white-space:normal;overflow-wrap:anywhere;min-width:12em}
.done{color:var(--good)}.failed{color:var(--bad)}.incomplete,.waiting{color:var(--warn)}
"""

# A click on a column's head sorts by it, another the other way round.
SORT = """
document.querySelectorAll('th button').forEach(button=>button.onclick=()=>{
const head=button.parentNode,column=head.cellIndex,body=head.closest('table').tBodies[0],up=head.getAttribute('aria-sort')!=='ascending';
for(const other of head.parentNode.cells)other.removeAttribute('aria-sort');head.setAttribute('aria-sort',up?'ascending':'descending');
const value=row=>{const text=row.cells[column].dataset.value??row.cells[column].textContent;return text===''||isNaN(text)?text:+text};
[...body.rows].sort((a,b)=>{const x=value(a),y=value(b);
const order=typeof x===typeof y?(x<y?-1:x>y?1:0):(typeof x==='number'?-1:1);return up?order:-order}).forEach(row=>body.append(row))});
"""


def link(path, text):
    return f'<a href="{html.escape(urllib.parse.quote(os.fsencode(path)))}">{html.escape(text)}</a>'


def cell(value, text=None):
    """A number, or nothing, as a cell of the table that sorts by it."""
    return f'<td data-value="{"" if value is None else value}">{"" if value is None else value if text is None else text}</td>'


def heading_cells(row):
    """Which capture a row is of, and what became of it."""
    state = row["state"]
    return f'<td>{row["number"]}</td><td class="left wide">{html.escape(row["capture"])}</td><td class="left {state}">{state}</td>'


def row_markup(row):
    got = row.get
    events = got("events", {})
    files = " ".join(link(row[name], text) for name, text in (("sound", "sound"), ("event_list", "events"), ("page", "page")) if name in row)
    dbfs = [cell(got(name), "silence" if got(name, 0) < SILENCE_DBFS else f"{got(name, 0):.1f}") for name in ("peak_dbfs", "rms_dbfs")]
    seconds = [cell(got(name), f"{got(name, 0):.2f}") for name in ("seconds", "elapsed_s", "processor_s")]
    lost = sum(row[loss] for loss in LOSSES) if "seconds" in row else None
    return (f"<tr>{heading_cells(row)}{seconds[0]}"
            + "".join(cell(events.get(kind)) for kind in KINDS) + "".join(dbfs) + cell(got("samples_limited")) + cell(lost) + seconds[1] + seconds[2]
            + f'<td class="left">{files}</td></tr>')


def page_of(report):
    totals = report["totals"]
    tiles = [(str(totals["captures"]), "captures"), (str(totals[DONE]), "done"), (str(totals[INCOMPLETE]), "incomplete"), (str(totals[FAILED]), "failed"),
             (str(totals[WAITING]), "not rendered yet"), (duration(totals["sound_s"]), "of sound"),
             *((str(totals["events"][kind]), kind) for kind in KINDS),
             (level(totals["peak_dbfs"]), "highest peak"), (level(totals["rms_dbfs"]), "RMS of all"), (str(totals["lost"]), "sounds or samples lost"),
             (duration(totals["processor_s"]), "of a processor")]
    if totals["capture_s"]:
        tiles += [(duration(totals["capture_s"]["median"]), "a capture, median"), (duration(totals["capture_s"]["most"]), "the longest"),
                  (f"{totals['memory_mb_most']:.0f} MB", "of memory at most")]
    failures = "".join(f'<tr>{heading_cells(row)}<td class="left wide">{html.escape(row["reason"])}</td></tr>\n' for row in report["failures"])
    heads = ("no.", "capture", "state", "sound, s", *KINDS, "peak, dBFS", "RMS, dBFS", "limited", "lost", "took, s", "processor, s", "files")
    columns = "".join(f'<th{" class=left" if head in ("capture", "state", "files") else ""}><button>{head}</button></th>' for head in heads)
    options = " ".join(report["options"]) or "the captures' own settings"
    return f"""<!DOCTYPE html>
<html lang="en">
<head>
<meta charset="utf-8">
<meta name="viewport" content="width=device-width, initial-scale=1">
<title>Batch: {html.escape(report["captures_folder"])}</title>
<style>{STYLE}</style>
</head>
<body>
<h1>Batch of {counted(totals["captures"], "capture")}</h1>
<p>{html.escape(report["captures_folder"])}, {html.escape(options)}, {html.escape(report["version"])}</p>
<ul>
{"".join(f"<li><b>{html.escape(number)}</b><span>{html.escape(label)}</span></li>" for number, label in tiles)}
</ul>
{f'''<section>
<h2>Not as it should be</h2>
<div class="scroll"><table><thead><tr><th>no.</th><th class="left">capture</th><th class="left">state</th><th class="left">why</th></tr></thead>
<tbody>{failures}</tbody></table></div>
</section>''' if failures else ""}
<section>
<h2>Captures</h2>
<div class="scroll"><table><thead><tr>{columns}</tr></thead>
<tbody>
{chr(10).join(row_markup(row) for row in report["captures"])}
</tbody></table></div>
</section>
<script>{SORT}</script>
</body>
</html>
"""
