import type { ClientMessage, SessionFigures } from "./wire/messages";

export const FRAMES_PER_SECOND = 30;

/**
 * Which session the page looks at and hears: the one that the reader chose, again by its name when the daemon or the session was started
 * anew; the first one there is until a choice was made. Nothing while nobody sees the page.
 */
export class Watching {
  private chosen: SessionFigures | null = null;
  private shown: string | null = null;
  private asked: { watch: string | null; listen: string | null } = { watch: null, listen: null };
  private pageVisible = true;
  private soundWanted = false;

  constructor(
    private readonly send: (message: ClientMessage) => boolean,
    private readonly changed: (session: string | null) => void,
  ) {}

  get session(): string | null {
    return this.shown;
  }

  choose(session: SessionFigures): void {
    this.chosen = session;
    this.show(session.id);
  }

  /** What there is now. */
  update(sessions: SessionFigures[]): void {
    if (sessions.some(({ id }) => id === this.shown)) return;
    const next = sessions.find(({ name, ended }) => name === this.chosen?.name && !ended) ?? sessions.find(({ ended }) => !ended) ?? sessions[0];
    this.show(next?.id ?? null);
  }

  setPageVisible(visible: boolean): void {
    this.pageVisible = visible;
    this.ask();
  }

  /** Sound is asked for while it is heard, or seen. */
  setSoundWanted(wanted: boolean): void {
    this.soundWanted = wanted;
    this.ask();
  }

  /** A new connection has been asked for nothing. */
  connected(): void {
    this.asked = { watch: null, listen: null };
    this.ask();
  }

  private show(session: string | null): void {
    if (session === this.shown) return;
    this.shown = session;
    this.changed(session);
    this.ask();
  }

  private ask(): void {
    const watch = this.pageVisible ? this.shown : null;
    if (watch !== this.asked.watch && this.send({ type: "watch", session: watch, frames_per_second: FRAMES_PER_SECOND })) this.asked.watch = watch;
    const listen = this.soundWanted ? this.shown : null;
    if (listen !== this.asked.listen && this.send({ type: "listen", session: listen })) this.asked.listen = listen;
  }
}
