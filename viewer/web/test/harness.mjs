// Test harness: a page in headless Chromium on the software driver SwiftShader, and its references.

import { execFileSync, spawnSync } from "node:child_process";
import fs from "node:fs";
import http from "node:http";
import { createRequire } from "node:module";
import path from "node:path";
import { fileURLToPath, pathToFileURL } from "node:url";

export const ROOT = fileURLToPath(new URL("../../../", import.meta.url));
const GOLDEN = path.join(ROOT, "viewer/tests/golden");
/** Vulkan driver file of SwiftShader, the page's driver, for other programs. */
const DRIVER = process.env.PALPATE_SWIFTSHADER;
const PALPATE = process.env.PALPATE;
/** Folder of the screenshots. */
export const OUT = path.join(ROOT, "target/page");
fs.rmSync(OUT, { recursive: true, force: true });
fs.mkdirSync(OUT, { recursive: true });
/** Height of the status bar, whose times and rates vary, in points. */
const STATUS = 26;
/** Timeout of every wait, ms. */
const WAIT = 600_000;

// The packages are not installed in a parent folder of this file.
const installed = createRequire(path.join(process.env.PALPATE_NODE, "package.json"));
const { default: puppeteer } = await import(pathToFileURL(installed.resolve("puppeteer-core")));

const FLAGS = ["--no-sandbox", "--ignore-gpu-blocklist", "--disable-background-networking"];
const GPU = [
  "--enable-unsafe-webgpu", "--use-webgpu-adapter=swiftshader", "--enable-features=Vulkan",
  "--use-vulkan=swiftshader", "--use-angle=swiftshader",
];

export const sleep = (ms) => new Promise((done) => setTimeout(done, ms));

export function check(is, why) {
  if (!is) throw new Error(why);
}

const KINDS = { ".html": "text/html", ".js": "text/javascript", ".wasm": "application/wasm" };

/** Serves the folder of the page, and data/ of the repository. */
export async function serve(site = path.join(ROOT, "target/web")) {
  const server = http.createServer((asked, answer) => {
    const name = decodeURIComponent(new URL(asked.url, "http://localhost").pathname);
    const folder = name.startsWith("/data/") ? ROOT : site;
    const file = path.join(folder, path.normalize(name === "/" ? "/index.html" : name));
    fs.readFile(file, (why, bytes) => {
      answer.writeHead(why ? 404 : 200, { "content-type": KINDS[path.extname(file)] ?? "application/octet-stream" });
      answer.end(bytes);
    });
  });
  await new Promise((done) => server.listen(0, "localhost", done));
  return { server, at: `http://localhost:${server.address().port}` };
}

export function launch({ webgpu = true, size = [1024, 768] } = {}) {
  const found = ["chromium", "chromium-browser"].map((name) =>
    spawnSync("sh", ["-c", `command -v ${name}`], { encoding: "utf8" }).stdout.trim());
  const executablePath = process.env.PALPATE_CHROMIUM ?? found.find((name) => name);
  check(executablePath, "Chromium not found; install it (on Debian: apt install chromium) or set PALPATE_CHROMIUM");
  const args = [...FLAGS, ...(webgpu ? GPU : ["--disable-features=WebGPU"])];
  const [width, height] = size;
  return puppeteer.launch({ executablePath, args, headless: true, protocolTimeout: 600_000, defaultViewport: { width, height } });
}

/** A page with the viewer in it. */
export class Page {
  /** Opens `address`; `prepared` runs in the page before its scripts. */
  static async open(browser, address, prepared = () => {}) {
    const page = await browser.newPage();
    const self = new Page(page);
    page.on("console", (said) => self.said.push(`${said.type()}: ${said.text()}`));
    page.on("pageerror", (why) => self.said.push(`pageerror: ${why.stack ?? why}`));
    await page.emulateMediaFeatures([{ name: "prefers-color-scheme", value: "dark" }]);
    await page.evaluateOnNewDocument(prepared);
    await page.evaluateOnNewDocument(watch);
    await page.goto(address, { timeout: WAIT });
    return self;
  }

  constructor(page) {
    this.page = page;
    this.said = [];
  }

  state() {
    return this.page.evaluate(() => document.querySelector("palpate-view")?.state?.() ?? {});
  }

  /** Calls a method of the element. */
  call(name, ...given) {
    return this.page.evaluate(
      (name, given) => document.querySelector("palpate-view")[name](...given), name, given);
  }

  /** Returns the events of the element since the last call. */
  events() {
    return this.page.evaluate(() => window.palpateEvents.splice(0));
  }

  async wait(what, is) {
    const since = Date.now();
    for (;;) {
      const state = await this.state();
      if (is(state)) return state;
      const said = this.said.slice(-5).join("\n");
      check(Date.now() - since < WAIT, `timed out waiting for ${what}: ${JSON.stringify(state)}\n${said}`);
      await sleep(20);
    }
  }

  /** Waits until no work is pending, the last frame is presented and no other frame is requested. */
  rest() {
    return this.wait("rest", ({ number, presented, busy, soon, pictures }) =>
      pictures > 0 && !busy && !soon && presented === number);
  }

  async key(name) {
    const { keys } = await this.state();
    await this.page.keyboard.press(name);
    await this.wait(`the key ${name}`, (state) => state.keys > keys);
  }

  /** Moves the pointer and waits until the viewer has received its position. */
  async to(x, y) {
    await this.page.mouse.move(x, y);
    await this.wait("the pointer", ({ pointer }) =>
      pointer && Math.abs(pointer[0] - x) < 1 && Math.abs(pointer[1] - y) < 1);
  }

  async click(x, y) {
    await this.to(x, y);
    await this.page.mouse.down();
    await this.wait("the button", (state) => state.down);
    await this.page.mouse.up();
    await this.wait("the button release", (state) => !state.down);
  }

  /** Presses the left button at one point and drags to another without releasing it. */
  async hold([x, y], [toX, toY]) {
    await this.to(x, y);
    await this.page.mouse.down();
    await this.wait("the button", (state) => state.down);
    for (let n = 1; n <= 12; n++) {
      await this.to(x + Math.trunc(((toX - x) * n) / 12), y + Math.trunc(((toY - y) * n) / 12));
    }
  }

  async letGo() {
    await this.page.mouse.up();
    await this.wait("the button release", (state) => !state.down);
    await this.rest();
  }

  /** Simulates a drop of files. */
  drop(files) {
    return this.page.evaluate((files) => {
      const dataTransfer = new DataTransfer();
      for (const [name, bytes] of files) {
        const binary = Uint8Array.from(atob(bytes), (c) => c.charCodeAt(0));
        dataTransfer.items.add(new File([binary], name));
      }
      const canvas = document.querySelector("palpate-view").shadowRoot.querySelector("canvas");
      for (const kind of ["dragenter", "dragover", "drop"]) {
        canvas.dispatchEvent(new DragEvent(kind, { dataTransfer, bubbles: true, cancelable: true }));
      }
    }, files.map(([name, bytes]) => [name, Buffer.from(bytes).toString("base64")]));
  }

  /** Takes a screenshot; without the status bar, unless `whole`. */
  async shot(name, whole = false) {
    const { width, height } = this.page.viewport();
    const file = path.join(OUT, `${name}.png`);
    await this.page.screenshot({ path: file, clip: { x: 0, y: 0, width, height: whole ? height : height - STATUS } });
    return file;
  }

  /**
   * Compares the screen with the golden image of this name. PALPATE_BLESS=1 rewrites the golden images
   * that only the page has (`own`); inspect them before committing.
   */
  async holdAgainst(name, alike, own = false) {
    // A phone has no pointer.
    if (this.page.viewport().hasTouch) await this.page.mouse.move(4, 700);
    else await this.to(4, 700);
    await this.rest();
    const shot = await this.shot(name);
    const golden = path.join(GOLDEN, `${name}.png`);
    if (own && process.env.PALPATE_BLESS) fs.copyFileSync(shot, golden);
    const off = apart(golden, shot);
    console.log(`${name}: differs from its golden by ${off.toFixed(4)}`);
    check(off <= alike, `${name}: differs from its golden by ${off}, at most ${alike}; see ${shot}`);
    return shot;
  }

  /** Saves a picture of the element. */
  async picture(name, width, height) {
    const bytes = await this.page.evaluate(async (width, height) => {
      const blob = await document.querySelector("palpate-view").screenshot(width, height);
      const read = new FileReader();
      await new Promise((done) => Object.assign(read, { onload: done }).readAsDataURL(blob));
      return read.result.split(",")[1];
    }, width, height);
    const file = path.join(OUT, `${name}.png`);
    fs.writeFileSync(file, Buffer.from(bytes, "base64"));
    return file;
  }
}

/** In the page: records events, and the time of the first picture. */
function watch() {
  window.palpateEvents = [];
  document.addEventListener("DOMContentLoaded", () => {
    const view = document.querySelector("palpate-view");
    for (const name of ["load", "error", "press", "camera"]) {
      view.addEventListener(name, (event) => window.palpateEvents.push([name, event.detail]));
    }
    const look = () => {
      if (!(view.state?.().pictures > 0)) return requestAnimationFrame(look);
      // It is presented by the next frame.
      requestAnimationFrame(() => requestAnimationFrame(() => (window.firstPicture = performance.now())));
    };
    look();
  });
}

/** Returns the root mean square difference of two pictures (range 0 to 1). */
export function apart(a, b) {
  const done = spawnSync(PALPATE, ["compare", a, b, "--json"], { encoding: "utf8" });
  check(done.stdout, `palpate compare ${a} ${b}: ${done.stderr}`);
  return JSON.parse(done.stdout).rmse;
}

/** Renders a scene with the command, on the page's driver. */
export function drawn(scene, file, [width, height]) {
  execFileSync(PALPATE, ["render", scene, "--out", file, "--size", `${width}x${height}`], {
    env: { ...process.env, VK_ICD_FILENAMES: DRIVER },
    stdio: ["ignore", "ignore", "inherit"],
  });
  return file;
}
