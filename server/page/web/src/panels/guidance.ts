import { byId, setHidden } from "../dom";

/** What to do where no session is attached: shown over the empty scene, each snippet with a button that copies it. */
export class Guidance {
  private readonly panel = byId("guidance");

  constructor() {
    for (const button of this.panel.querySelectorAll<HTMLButtonElement>("[data-copy]")) {
      button.addEventListener("click", () => void this.copy(button));
    }
  }

  show(shown: boolean): void {
    setHidden(this.panel, !shown);
  }

  private async copy(button: HTMLButtonElement): Promise<void> {
    const snippet = byId(button.dataset["copy"]!);
    try {
      await navigator.clipboard.writeText(snippet.textContent ?? "");
      button.textContent = "Copied";
      window.setTimeout(() => (button.textContent = "Copy"), 2000);
    } catch {
      // Where the browser does not let the page write, the text is selected for the reader to copy.
      window.getSelection()?.selectAllChildren(snippet);
    }
  }
}
