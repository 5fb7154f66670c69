/** Light or dark: the system's choice unless the reader chose; the choice is remembered by the browser. */

const KEY = "rustle-theme";
const system = window.matchMedia("(prefers-color-scheme: dark)");
const watchers: ((dark: boolean) => void)[] = [];
let chosen: string | null = remembered();

export function isDark(): boolean {
  return chosen ? chosen === "dark" : system.matches;
}

export function onTheme(watcher: (dark: boolean) => void): void {
  watchers.push(watcher);
  watcher(isDark());
}

/** A browser that keeps nothing for pages (cookies blocked) throws: then the choice lasts as long as the page. */
function remembered(): string | null {
  try {
    return localStorage.getItem(KEY);
  } catch {
    return null;
  }
}

function remember(theme: string | null): void {
  try {
    if (theme) localStorage.setItem(KEY, theme);
    else localStorage.removeItem(KEY);
  } catch {
    return;
  }
}

function apply(): void {
  if (chosen) document.documentElement.dataset["theme"] = chosen;
  else delete document.documentElement.dataset["theme"];
  for (const watcher of watchers) watcher(isDark());
}

export function toggleTheme(): void {
  const wanted = isDark() ? "light" : "dark";
  // Back at what the system says, the page follows the system again.
  const followSystem = (wanted === "dark") === system.matches;
  chosen = followSystem ? null : wanted;
  remember(chosen);
  apply();
}

system.addEventListener("change", apply);
apply();
