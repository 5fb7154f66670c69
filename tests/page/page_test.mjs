/** The page as a reader has it, in headless Chromium, before a daemon that is made up. */
import assert from "node:assert/strict";
import { after, before, describe, test } from "node:test";
import { launch, open } from "./browser.mjs";
import { KEY, Mock } from "./mock.mjs";

const READ_ONLY = { rights: { listen: false, change: false }, needsKey: true };
let browser;
before(async () => (browser = await launch()));
after(() => browser.close());

/** Runs `body` with the page before a mock; afterwards the page must have complained of nothing. */
async function withPage({ mock: options = {}, page: pageOptions = {}, complains = false }, body) {
  const mock = await new Mock(options).listen();
  const { page, complaints } = await open(browser, mock.url, pageOptions);
  try {
    await body({ page, mock });
    if (!complains) assert.deepEqual(complaints, []);
  } finally {
    await page.context().close();
    await mock.close();
  }
}

const text = (page, selector) => page.locator(selector).innerText();
const shows = (page, selector, wanted) => page.waitForFunction(([at, part]) => document.querySelector(at)?.textContent.includes(part), [selector, wanted]);
const scenesShown = (page) => page.waitForFunction(() => /triangles/.test(document.querySelector("#scene-facts").textContent));

async function asked(mock, wanted, why = JSON.stringify(wanted)) {
  for (let i = 0; i < 200; ++i) {
    const found = mock.received.find((message) => Object.entries(wanted).every(([name, value]) => JSON.stringify(message[name]) === JSON.stringify(value)));
    if (found) return found;
    await new Promise((resolve) => setTimeout(resolve, 25));
  }
  assert.fail(`never asked: ${why}; asked was ${JSON.stringify(mock.received)}`);
}

/** How many pixels of an element's picture are within `near` of a colour. */
async function pixelsNear(page, selector, [r, g, b], near = 40) {
  const picture = await page.locator(selector).screenshot();
  return page.evaluate(
    async ([bytes, colour, within]) => {
      const bitmap = await createImageBitmap(new Blob([new Uint8Array(bytes)], { type: "image/png" }));
      const context = new OffscreenCanvas(bitmap.width, bitmap.height).getContext("2d");
      context.drawImage(bitmap, 0, 0);
      const { data } = context.getImageData(0, 0, bitmap.width, bitmap.height);
      let found = 0;
      for (let i = 0; i < data.length; i += 4) if (colour.every((value, k) => Math.abs(data[i + k] - value) < within)) ++found;
      return found;
    },
    [[...picture], [r, g, b], near],
  );
}
const ORANGE = [228, 148, 96];
const PURPLE = [190, 156, 214];

describe("what is shown", () => {
  test("the daemon, its figures and its sessions", () =>
    withPage({}, async ({ page, mock }) => {
      await shows(page, "#where", "rustled 0.9.0 on workshop");
      await shows(page, "#load-level", "full quality");
      await page.waitForFunction(() => /^\d\.\d$/.test(document.querySelector("#latency-p50").textContent));
      assert.equal(await page.locator("#session-list li").count(), 8);
      assert.equal(await text(page, "#session-count"), "8");
      assert.equal(await text(page, "#uptime"), "1 d 0 h");
      mock.loadLevel = 2;
      await shows(page, "#load-level", "fewer voices");
      assert.equal(await page.locator("#load-steps").getAttribute("data-level"), "2");
    }));

  test("the first session's sheet, coloured by region, which may be left out", () =>
    withPage({}, async ({ page, mock }) => {
      await asked(mock, { type: "watch", session: "s-1", frames_per_second: 30 });
      await scenesShown(page);
      assert.match(await text(page, "#scene-facts"), /printer-paper · 1\u2009333 triangles/);
      assert.match(await text(page, "#grid-size"), /^1 square = \d+ cm$/);
      assert.ok((await pixelsNear(page, "#stage", ORANGE)) > 8000);
      assert.ok((await pixelsNear(page, "#stage", PURPLE)) > 4000);
      await page.click("#legend button:has-text('Regions')");
      await page.waitForTimeout(300);
      assert.ok((await pixelsNear(page, "#stage", ORANGE)) < 2000);
    }));

  test("the sound's spectrogram and levels, before anything is heard", () =>
    withPage({}, async ({ page, mock }) => {
      await asked(mock, { type: "listen", session: "s-1" });
      await page.waitForFunction(() => Number(document.querySelector("#meter-bars").ariaValueNow ?? -72) > -60);
      await page.waitForTimeout(2500);
      const colours = await page.evaluate(() => {
        const canvas = document.querySelector("#spectrogram");
        const { data } = canvas.getContext("2d").getImageData(canvas.width - 60, 0, 60, canvas.height);
        return new Set(new Uint32Array(data.buffer)).size;
      });
      assert.ok(colours > 40, `${colours} colours`);
      assert.match(await text(page, "#listening-facts"), /^Muted/);
    }));

  test("losses by cause, the most frequent first, with what to do", () =>
    withPage({}, async ({ page }) => {
      await page.click("#session-list button:has-text('kitchen roll')");
      await shows(page, "#losses", "quota");
      const causes = await page.locator("#losses .loss-head code").allInnerTexts();
      assert.deepEqual(causes, ["quota", "reordered"]);
      assert.match(await text(page, "#losses li:first-child"), /310\s+beyond what the sender's key may send[^]*rustle keys allow/);
      await page.click("#session-list button:has-text('banknote')");
      await shows(page, "#losses", "None.");
      assert.equal(await page.locator("#losses li").count(), 0);
    }));

  test("what to do where nothing is attached, until something is", () =>
    withPage({ mock: { sessions: 0 } }, async ({ page, mock }) => {
      await shows(page, "#guidance h3", "Nothing is attached yet");
      assert.ok(await page.locator("#guidance").isVisible());
      assert.equal((await text(page, "#attach-snippet")).split("\n").length, 10);
      const { sessions } = new Mock();
      mock.sessions.push(...sessions.slice(0, 1));
      await page.waitForSelector("#guidance", { state: "hidden" });
      await asked(mock, { type: "watch", session: "s-1" });
      await shows(page, "#watched-name", "flag");
    }));

  test("a session that is sought", () =>
    withPage({}, async ({ page }) => {
      await page.fill("#session-search", "CURTAIN");
      assert.deepEqual(await page.locator(".session-name").allInnerTexts(), ["curtain, north window"]);
      await page.fill("#session-search", "no such");
      assert.match(await text(page, "#session-none"), /No session's name/);
    }));

  test("what the daemon sends is shown as words, not run as a page", () =>
    withPage({}, async ({ page, mock }) => {
      mock.sessions[0].name = "<img src=x onerror=alert(1)>";
      await shows(page, ".session-name", "<img");
      assert.equal(await page.locator(".session-name img").count(), 0);
    }));

  test("an unreadable message is told, and what follows is shown", () =>
    withPage({}, async ({ page, mock }) => {
      await scenesShown(page);
      for (const client of mock.server.clients) {
        client.send("{not json");
        client.send(new Uint8Array([2, 0, 0]));
        client.send(JSON.stringify({ type: "of tomorrow" }));
      }
      await shows(page, "#notices", "load the page again");
      assert.equal(await page.locator(".notice").count(), 1);
      mock.loadLevel = 1;
      await shows(page, "#load-level", "bursts merged");
    }));
});

test("a browser without WebGL has all but the picture", async () => {
  const mock = await new Mock().listen();
  const { page, complaints } = await open(browser, "about:blank");
  try {
    await page.addInitScript(() => {
      const getContext = HTMLCanvasElement.prototype.getContext;
      HTMLCanvasElement.prototype.getContext = function (kind, ...more) {
        return kind.startsWith("webgl") ? null : getContext.call(this, kind, ...more);
      };
    });
    await page.goto(mock.url);
    await page.waitForSelector("#scene-none:not([hidden])");
    await shows(page, "#watched-name", "flag");
    await page.waitForFunction(() => document.querySelector("#meter-bars").ariaValueNow > -60);
    assert.deepEqual(complaints, []);
  } finally {
    await page.context().close();
    await mock.close();
  }
});

describe("what the reader does", () => {
  test("all of it by keyboard: choose, listen, turn, move the listener, change a gain", () =>
    withPage({}, async ({ page, mock }) => {
      await scenesShown(page);
      await page.keyboard.press("Tab");
      assert.equal(await page.evaluate(() => document.activeElement.textContent), "Skip to the sheet");
      const order = [];
      for (let i = 0; i < 80; ++i) {
        await page.keyboard.press("Tab");
        const at = await page.evaluate(() => {
          const { activeElement: element } = document;
          if (element === document.body) return null;
          const named = element.getAttribute("aria-label") ?? element.labels?.[0]?.textContent ?? element.textContent;
          return { id: element.id || element.className, name: named.trim(), outline: getComputedStyle(element).outlineStyle };
        });
        if (!at) break;
        order.push(at);
      }
      for (const { id, name, outline } of order) {
        assert.ok(name, `${id} has no name`);
        assert.notEqual(outline, "none", `${id} does not show that it has the focus`);
      }
      const ids = order.map(({ id }) => id.split(" ")[0]);
      for (const wanted of ["theme", "listen", "session-search", "session", "scene", "fit", "legend-item", "listener-handle", "gain-master", "gain-tearing", "listener-x", "key-secret"]) {
        assert.ok(ids.includes(wanted), `Tab never comes to ${wanted}: ${ids}`);
      }

      await page.focus("#session-search");
      for (const key of ["ArrowDown", "ArrowDown", "Enter"]) await page.keyboard.press(key);
      await asked(mock, { type: "watch", session: "s-2" });
      await shows(page, "#watched-name", "letter being torn");
      assert.equal(await page.locator("[aria-current]").innerText().then((words) => words.split("\n")[0]), "letter being torn");

      await page.focus("#listen");
      await page.keyboard.press("Space");
      await shows(page, "#listen-label", "Listening");

      await page.waitForSelector(".listener-handle:not([hidden])");
      await page.focus(".listener-handle");
      await page.keyboard.press("ArrowRight");
      await page.keyboard.press("PageUp");
      await page.keyboard.press("Shift+ArrowUp");
      await page.waitForFunction(() => document.querySelector("#listener-y").value === "-0.10");
      assert.equal(await page.inputValue("#listener-x"), "0.13");
      assert.equal(await page.inputValue("#listener-z"), "0.25");
      await page.waitForFunction(() => document.querySelector(".listener-handle").ariaLabel === "Listener at x 0.13, y -0.10, z 0.25 metres");

      await page.focus("#gain-friction");
      await page.keyboard.press("ArrowUp");
      await asked(mock, { type: "gain", session: "s-2", kind: "friction", db: -5.5 });
      await page.keyboard.press("Home");
      await asked(mock, { type: "gain", session: "s-2", kind: "friction", db: null }, "silence");
      await shows(page, ".gain:has(#gain-friction) output", "−∞ dB");
    }));

  test("the listener is dragged, and typed", () =>
    withPage({}, async ({ page, mock }) => {
      mock.sessions[0].listener.position = [0, 0, 0.1];
      await page.reload();
      await page.waitForSelector(".listener-handle:not([hidden]):not(.away)");
      await scenesShown(page);
      const box = await page.locator(".listener-handle").boundingBox();
      await page.mouse.move(box.x + 17, box.y + 17);
      await page.mouse.down();
      await page.mouse.move(box.x + 77, box.y + 17, { steps: 5 });
      await page.mouse.up();
      const told = await asked(mock, { type: "listener", session: "s-1" });
      assert.equal(told.position.length, 3);
      await page.waitForFunction(() => Number(document.querySelector("#listener-x").value) > 0.02);
      const after = await page.locator(".listener-handle").boundingBox();
      assert.ok(Math.abs(after.x - box.x - 60) < 3, `at ${after.x}, dragged to ${box.x + 60}`);
      await page.fill("#listener-z", "1.25");
      await page.keyboard.press("Enter");
      for (let i = 0; i < 100 && mock.sessions[0].listener.position[2] !== 1.25; ++i) await page.waitForTimeout(20);
      assert.equal(mock.sessions[0].listener.position[2], 1.25);
    }));

  test("without the right nothing can be changed or heard, and the page says why, until a key is given", () =>
    withPage({ mock: READ_ONLY }, async ({ page, mock }) => {
      await scenesShown(page);
      await shows(page, "#change-reason", "Give a key that may change sessions");
      for (const kind of ["master", "crumpling", "friction", "tearing"]) assert.ok(await page.isDisabled(`#gain-${kind}`));
      assert.ok(await page.isDisabled("#listen"));
      assert.ok(await page.isDisabled("#listener-x"));
      await page.focus(".listener-handle");
      await page.keyboard.press("ArrowRight");
      assert.match(await text(page, "#spectrogram-none"), /needs a key/);
      assert.deepEqual([...new Set(mock.received.map(({ type }) => type))], ["watch"]);

      await page.fill("#key-secret", KEY.replace("0", "x"));
      await page.keyboard.press("Enter");
      await shows(page, "#notices", "not let in");
      assert.ok(await page.isDisabled("#gain-master"));
      await page.fill("#key-secret", KEY);
      await page.keyboard.press("Enter");
      await page.waitForSelector("#gain-master:not([disabled])");
      await page.waitForSelector("#listen:not([disabled])");
      await shows(page, "#notices", "The key was let in: it may listen to sessions and change them.");
      assert.equal(await page.locator(".notice").count(), 1, "what the wrong key brought is gone");
      await asked(mock, { type: "listen", session: "s-1" });
      assert.equal(await page.inputValue("#key-secret"), "");
      assert.ok(!(await page.evaluate(() => JSON.stringify([localStorage, sessionStorage, document.cookie]))).includes(KEY));
    }));

  test("the daemon goes and comes: the page says so, connects again, watches the same session with the same key", () =>
    withPage({ mock: READ_ONLY, complains: true }, async ({ page, mock }) => {
      await scenesShown(page);
      await page.fill("#key-secret", KEY);
      await page.keyboard.press("Enter");
      await page.click("#session-list button:has-text('banknote')");
      await asked(mock, { type: "watch", session: "s-4" });
      await mock.close();
      await page.waitForSelector("#banner:not([hidden])");
      assert.match(await text(page, "#banner"), /reconnecting in/);
      assert.ok(await page.isDisabled("#gain-master"));
      const again = new Mock(READ_ONLY);
      again.sessions.find(({ name }) => name === "banknote").id = "s-44"; // sessions of another run have other ids
      await again.listen(mock.port);
      try {
        await page.waitForSelector("#banner", { state: "hidden" });
        await asked(again, { type: "key", secret: KEY });
        await asked(again, { type: "watch", session: "s-44" });
        await shows(page, "#watched-name", "banknote");
        await page.waitForSelector("#gain-master:not([disabled])");
      } finally {
        await again.close();
        await mock.listen(mock.port);
      }
    }));

  test("a page that nobody sees asks for nothing", () =>
    withPage({}, async ({ page, mock }) => {
      await asked(mock, { type: "listen", session: "s-1" });
      await page.evaluate(() => {
        Object.defineProperty(document, "hidden", { value: true, configurable: true });
        document.dispatchEvent(new Event("visibilitychange"));
      });
      await asked(mock, { type: "watch", session: null });
      await asked(mock, { type: "listen", session: null });
    }));
});

/** What stands beyond the right edge, or is wider than the window. What scrolls by itself may. */
function sidewards(page) {
  return page.evaluate(() => {
    const out = [...document.querySelectorAll("body *:not(.skip):not(.meter-channel *)")]
      .filter((element) => element.checkVisibility() && element.getBoundingClientRect().right > innerWidth + 0.5)
      .map((element) => element.id || element.className || element.tagName);
    if (document.scrollingElement.scrollWidth > innerWidth) out.push(`${document.scrollingElement.scrollWidth} of ${innerWidth} pixels`);
    return out;
  });
}

describe("how it looks", () => {
  test("at a phone's width what to do without a session fits as well", () =>
    withPage({ mock: { sessions: 0 }, page: { width: 360, height: 740 } }, async ({ page }) => {
      await page.waitForSelector("#guidance:not([hidden])");
      assert.deepEqual(await sidewards(page), []);
    }));

  for (const [width, height] of [[360, 740], [390, 844], [768, 1024], [1100, 800], [1440, 900]]) {
    test(`at ${width} pixels nothing is cut off and nothing scrolls sideways`, () =>
      withPage({ page: { width, height } }, async ({ page }) => {
        await scenesShown(page);
        await page.click("#session-list button:has-text('kitchen roll')");
        await shows(page, "#losses", "quota");
        assert.deepEqual(await sidewards(page), []);
        for (const selector of ["#listen", "#scene", "#spectrogram", "#gain-master", "#key-secret"]) assert.ok(await page.locator(selector).isVisible(), selector);
        if (width < 500) {
          const small = await page.evaluate(() =>
            [...document.querySelectorAll("button, input")]
              .filter((element) => element.checkVisibility({ visibilityProperty: true }) && element.getBoundingClientRect().height < 24)
              .map((element) => element.id || element.className),
          );
          assert.deepEqual(small, [], "too small for a finger");
        }
      }));
  }

  test("light and dark as the system says, or as the reader chose, which is remembered", () =>
    withPage({ page: { colorScheme: "dark" } }, async ({ page }) => {
      const ground = () => page.evaluate(() => getComputedStyle(document.body).backgroundColor);
      const dark = await ground();
      assert.equal(dark, "rgb(13, 15, 18)");
      await page.emulateMedia({ colorScheme: "light" });
      const light = await ground();
      assert.equal(light, "rgb(241, 239, 234)");
      await page.click("#theme");
      assert.equal(await ground(), dark);
      await page.reload();
      assert.equal(await ground(), dark);
      await page.click("#theme");
      assert.equal(await ground(), light);
    }));

  test("words are told apart from their ground in both", async () => {
    for (const colorScheme of ["light", "dark"]) {
      await withPage({ page: { colorScheme } }, async ({ page }) => {
        await page.click("#session-list button:has-text('kitchen roll')");
        await shows(page, "#losses", "quota");
        const poor = await page.evaluate(() => {
          const channels = (colour) => colour.match(/[\d.]+/g).map(Number);
          const luminance = (colour) => {
            const [r, g, b] = channels(colour).map((value) => (value / 255 <= 0.04045 ? value / 255 / 12.92 : ((value / 255 + 0.055) / 1.055) ** 2.4));
            return 0.2126 * r + 0.7152 * g + 0.0722 * b;
          };
          const ground = (element) => {
            for (let at = element; at; at = at.parentElement) {
              const colour = getComputedStyle(at).backgroundColor;
              if (/^rgb\(/.test(colour)) return colour;
            }
            return getComputedStyle(document.body).backgroundColor;
          };
          const out = [];
          for (const element of document.querySelectorAll("h1, h2, p, dt, dd, small, span, button, label, code, output")) {
            const own = [...element.childNodes].some((node) => node.nodeType === Node.TEXT_NODE && node.data.trim());
            if (!own || element.closest(".skip") || !element.checkVisibility({ visibilityProperty: true }) || element.closest(":disabled")) continue;
            const [a, b] = [luminance(getComputedStyle(element).color), luminance(ground(element))];
            const contrast = (Math.max(a, b) + 0.05) / (Math.min(a, b) + 0.05);
            if (contrast < 4.5) out.push(`${element.id || element.className || element.textContent}: ${contrast.toFixed(2)}`);
          }
          return out;
        });
        assert.deepEqual(poor, [], colorScheme);
      });
    }
  });
});
