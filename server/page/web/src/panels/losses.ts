import { create, setText } from "../dom";
import { count, percent } from "../format";
import type { SessionFigures } from "../wire/messages";

interface Meaning {
  says: string;
  remedy: string;
}

const MEANINGS: Record<string, Meaning> = {
  backlog: {
    says: "came faster than they could be analysed",
    remedy: "Send fewer frames a second or a coarser mesh, or start rustled with more `--analysis-workers`.",
  },
  budget: {
    says: "beyond the session's budget while others were there",
    remedy: "Send a coarser mesh, or raise `--budget-analysis` or `--budget-megabytes`.",
  },
  quota: {
    says: "beyond what the sender's key may send",
    remedy: "Send less, or allow the key more: `rustle keys allow` with `--frames-per-s` and `--bytes-per-s`.",
  },
  reordered: { says: "came after a newer frame of the same sheet", remedy: "Send frames in the order of their time, over one connection." },
  discarded: { says: "still waited when their sheet or session ended", remedy: "Nothing to do, unless the session should have gone on." },
  unannounced: { says: "came before their session was announced", remedy: "Attach before the first frame; publishers repeat their announcement every second." },
  memory: { says: "the daemon had no memory for", remedy: "Use coarser meshes or fewer sessions, or give the machine more memory." },
  refused: { says: "the analysis could not take", remedy: "The session's notices say which field was wrong." },
  malformed: { says: "were not shaped as the protocol says", remedy: "The session's notices name the field." },
  out_of_range: { says: "had a number beyond its range", remedy: "Check units: positions are metres unless `metres_per_unit` says otherwise." },
  not_finite: { says: "had numbers that are none (NaN, infinite)", remedy: "The simulation blew up, or divided by zero: check its step." },
  time_order: { says: "were older than one already taken", remedy: "Send in the order of time; to begin anew, attach a new session." },
  too_large: { says: "were larger than a session may send", remedy: "Send a coarser mesh, or several sheets." },
  unknown_topology: { says: "named a topology that was never sent", remedy: "Send the topology before its first frame." },
};

const UNKNOWN: Meaning = { says: "were dropped", remedy: "The daemon's log says why." };

class Row {
  readonly object = create("li", "loss");
  private readonly frames = create("strong");
  private readonly share = create("span", "loss-share");
  private readonly fill = create("i");
  private shown = -1;

  constructor(cause: string) {
    const { says, remedy } = MEANINGS[cause] ?? UNKNOWN;
    const bar = create("span", "loss-bar");
    bar.setAttribute("aria-hidden", "true");
    bar.append(this.fill);
    const head = create("p", "loss-head");
    const words = create("span");
    words.append(this.frames, ` ${says} `, create("code", "", cause));
    head.append(words, this.share);
    this.object.append(head, bar, withCode(create("p", "loss-remedy"), remedy));
  }

  show(frames: number, received: number): void {
    if (frames + received === this.shown) return;
    this.shown = frames + received;
    setText(this.frames, count(frames));
    setText(this.share, percent(frames, received));
    this.fill.style.transform = `scaleX(${Math.min(1, frames / Math.max(1, received)).toFixed(3)})`;
  }
}

/** Text in which `backticks` mark what is typed. */
function withCode(into: HTMLElement, text: string): HTMLElement {
  into.append(...text.split("`").map((part, i) => (i % 2 === 1 ? create("code", "", part) : part)));
  return into;
}

/** What became of the watched session's frames: analysed, or lost, by cause, with what to do about it. */
export class Losses {
  private readonly summary = create("p", "loss-summary");
  private readonly list = create("ul", "loss-list");
  private readonly rows = new Map<string, Row>();

  constructor(
    into: HTMLElement,
    private readonly total: HTMLElement,
  ) {
    into.append(this.summary, this.list);
  }

  update(session: SessionFigures | null): void {
    const frames = session?.frames ?? { received: 0, analysed: 0, dropped: {} };
    const causes = Object.entries(frames.dropped).sort(([, a], [, b]) => b - a);
    const lost = causes.reduce((sum, [, n]) => sum + n, 0);
    setText(this.total, lost > 0 ? `${percent(lost, frames.received)} of frames` : "");
    if (!session) setText(this.summary, "Frames of the watched session, and what became of them.");
    else if (lost === 0) setText(this.summary, `None. ${count(frames.analysed)} of ${count(frames.received)} frames are analysed.`);
    else setText(this.summary, `${count(frames.analysed)} of ${count(frames.received)} frames are analysed.`);
    for (const [cause, row] of this.rows) {
      if (frames.dropped[cause]) continue;
      row.object.remove();
      this.rows.delete(cause);
    }
    causes.forEach(([cause, n], place) => {
      let row = this.rows.get(cause);
      if (!row) this.rows.set(cause, (row = new Row(cause)));
      row.show(n, frames.received);
      if (this.list.children[place] !== row.object) this.list.insertBefore(row.object, this.list.children[place] ?? null);
    });
  }
}
