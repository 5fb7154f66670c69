import { create, setAttribute, setHidden, setText } from "../dom";
import { count, dbfs } from "../format";
import type { SessionFigures } from "../wire/messages";

const SEARCH_FROM = 7;
const METER_LOWEST_DB = -72;

class Row {
  readonly object = create("li");
  readonly button = create("button", "session");
  private readonly name = create("span", "session-name");
  private readonly facts = create("span", "session-facts");
  private readonly level = create("span", "session-level");
  private readonly bar = create("span", "session-bar");
  private readonly fill = create("i");
  private readonly lost = create("span", "session-lost");
  private barAt = -1;

  constructor(readonly id: string) {
    this.button.type = "button";
    this.bar.setAttribute("aria-hidden", "true");
    this.bar.append(this.fill);
    this.button.append(this.name, this.level, this.facts, this.lost, this.bar);
    this.object.append(this.button);
  }

  show(session: SessionFigures): void {
    setText(this.name, session.name || session.id);
    setAttribute(this.button, "title", session.name);
    setText(this.level, dbfs(session.peak_db));
    const sheets = session.sheets === 1 ? "1 sheet" : `${session.sheets} sheets`;
    setText(this.facts, `${session.ended ? "ended" : session.clock} · ${sheets}`);
    const lost = Object.values(session.frames.dropped).reduce((sum, frames) => sum + frames, 0);
    setText(this.lost, lost > 0 ? `${count(lost)} lost` : "");
    const bar = Math.round(100 * Math.min(Math.max(1 - (session.peak_db ?? -200) / METER_LOWEST_DB, 0), 1));
    if (bar !== this.barAt) this.fill.style.transform = `scaleX(${bar / 100})`;
    this.barAt = bar;
  }
}

/** The daemon's sessions; one is watched. Arrow keys go from one to the next. */
export class SessionList {
  private readonly rows = new Map<string, Row>();
  private watched: string | null = null;
  private sessions: SessionFigures[] = [];
  private sought = "";

  constructor(
    private readonly list: HTMLElement,
    private readonly search: HTMLInputElement,
    private readonly total: HTMLElement,
    private readonly none: HTMLElement,
    private readonly choose: (id: string) => void,
  ) {
    search.addEventListener("input", () => {
      this.sought = search.value.trim().toLowerCase();
      this.update(this.sessions);
    });
    list.addEventListener("keydown", (event) => this.key(event));
    search.addEventListener("keydown", (event) => {
      if (event.key === "ArrowDown") this.focus(0, event);
    });
  }

  setWatched(id: string | null): void {
    this.watched = id;
    for (const row of this.rows.values()) this.mark(row);
  }

  update(sessions: SessionFigures[]): void {
    this.sessions = sessions;
    const shown = sessions.filter(({ name, id }) => !this.sought || name.toLowerCase().includes(this.sought) || id.includes(this.sought));
    const kept = new Set(shown.map(({ id }) => id));
    for (const [id, row] of this.rows) {
      if (kept.has(id)) continue;
      row.object.remove();
      this.rows.delete(id);
    }
    shown.forEach((session, place) => {
      const row = this.rows.get(session.id) ?? this.add(session.id);
      row.show(session);
      if (this.list.children[place] !== row.object) this.list.insertBefore(row.object, this.list.children[place] ?? null);
    });
    setHidden(this.search, sessions.length < SEARCH_FROM && !this.sought);
    setText(this.total, sessions.length === 0 ? "" : count(sessions.length));
    setHidden(this.none, shown.length > 0);
    if (shown.length === 0) setText(this.none, this.sought ? "No session's name has this in it." : "None yet. A session appears here as soon as it is attached.");
  }

  private add(id: string): Row {
    const row = new Row(id);
    row.button.addEventListener("click", () => this.choose(id));
    this.rows.set(id, row);
    this.mark(row);
    return row;
  }

  private mark(row: Row): void {
    setAttribute(row.button, "aria-current", row.id === this.watched ? "true" : null);
  }

  private key(event: KeyboardEvent): void {
    const buttons = [...this.list.querySelectorAll("button")];
    const at = buttons.indexOf(document.activeElement as HTMLButtonElement);
    const to = { ArrowDown: at + 1, ArrowUp: at - 1, Home: 0, End: buttons.length - 1 }[event.key];
    if (at >= 0 && to !== undefined) this.focus(to, event);
  }

  private focus(at: number, event: KeyboardEvent): void {
    const button = this.list.querySelectorAll("button")[at];
    if (!button) return;
    event.preventDefault();
    button.focus();
  }
}
