import { byId } from "../dom";

const KEY_LENGTH = 40; // Z85 of 32 bytes

/** A field for a secret key, which is told to the daemon and kept nowhere but in this tab's memory. */
export class KeyForm {
  private readonly input = byId<HTMLInputElement>("key-secret");
  private secret: string | null = null;

  constructor(private readonly send: (secret: string) => void) {
    byId<HTMLFormElement>("key-form").addEventListener("submit", (event) => {
      event.preventDefault();
      const secret = this.input.value.trim();
      this.input.setCustomValidity(secret.length === KEY_LENGTH ? "" : `A secret key has ${KEY_LENGTH} characters; this has ${secret.length}.`);
      if (!this.input.reportValidity()) return;
      this.secret = secret;
      this.input.value = "";
      this.send(secret);
    });
    this.input.addEventListener("input", () => this.input.setCustomValidity(""));
  }

  /** A new connection knows nothing of the key. */
  again(): void {
    if (this.secret !== null) this.send(this.secret);
  }
}
