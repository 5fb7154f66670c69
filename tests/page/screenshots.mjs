/**
 * Pictures of the page, to look at: node tests/page/screenshots.mjs FOLDER [URL]
 * Of a daemon at URL, or without one of the mock.
 */
import { mkdir } from "node:fs/promises";
import { join } from "node:path";
import { launch, open } from "./browser.mjs";
import { Mock } from "./mock.mjs";

const [folder, address] = process.argv.slice(2);
if (!folder) {
  console.error("usage: node tests/page/screenshots.mjs FOLDER [URL]");
  process.exit(2);
}
await mkdir(folder, { recursive: true });
const browser = await launch();
const shoot = async (name, url, options, { wait = 6000, listen = false } = {}) => {
  const { page, complaints } = await open(browser, url, options);
  if (listen) await page.click("#listen:not([disabled])");
  await page.waitForTimeout(wait);
  await page.screenshot({ path: join(folder, `${name}.png`), fullPage: (options.width ?? 1440) < 800 });
  console.log(name, complaints);
  await page.context().close();
};
const mock = address ? null : await new Mock().listen();
const url = address ?? mock.url;
await shoot("desk_light", url, { colorScheme: "light" }, { wait: 14000, listen: true });
await shoot("desk_dark", url, { colorScheme: "dark" }, { wait: 9000 });
await shoot("phone_light", url, { width: 390, height: 844, colorScheme: "light", deviceScaleFactor: 2, isMobile: true, hasTouch: true });
await shoot("phone_dark", url, { width: 360, height: 740, colorScheme: "dark", deviceScaleFactor: 2, isMobile: true, hasTouch: true });
if (mock) {
  await mock.close();
  const empty = await new Mock({ sessions: 0, rights: { listen: false, change: false }, needsKey: true }).listen();
  await shoot("empty_light", empty.url, { colorScheme: "light" }, { wait: 1500 });
  await shoot("empty_phone", empty.url, { width: 390, height: 844, colorScheme: "dark", deviceScaleFactor: 2, isMobile: true, hasTouch: true }, { wait: 1500 });
  await empty.close();
  const readOnly = await new Mock({ sessions: 3, rights: { listen: false, change: false }, needsKey: true }).listen();
  await shoot("read_only_dark", readOnly.url, { colorScheme: "dark" }, { wait: 2500 });
  await readOnly.close();
}
await browser.close();
