import { create } from "../dom";
import type { Notice } from "../wire/messages";

const SHOWN_MS = 8000;
const MOST = 4;

/** What the daemon or the page has to say, for a while; errors stay until they are closed. */
export class Notices {
  constructor(private readonly list: HTMLElement) {}

  clear(): void {
    this.list.replaceChildren();
  }

  show(text: string, level: Notice["level"]): void {
    const same = [...this.list.children].find((one) => one.firstElementChild?.textContent === text);
    same?.remove();
    const notice = create("div", `notice ${level}`);
    const close = create("button", "quiet small", "Close");
    close.type = "button";
    close.addEventListener("click", () => notice.remove());
    notice.append(create("p", "", text), close);
    this.list.append(notice);
    while (this.list.childElementCount > MOST) this.list.firstElementChild!.remove();
    if (level !== "error") window.setTimeout(() => notice.remove(), SHOWN_MS);
  }
}
