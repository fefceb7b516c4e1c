// <palpate-view src="liver.vtu" transfer="tissue">: the viewer as an element of a page.

import init, { Viewer } from "./palpate_view.js";

const WASM = new URL("palpate_view_bg.wasm", import.meta.url);
const NO_WEBGPU =
  "This page draws with WebGPU, which this browser does not have or has switched off. " +
  "Chrome and Edge from 113 on, Safari from 26 on and Firefox from 141 on have it; " +
  "on Linux it may have to be switched on.";

let ready;

/** The bytes at an address; an error that says what was asked for. */
async function fetched(url) {
  const answer = await fetch(url).catch((why) => {
    throw new Error(`${url}: ${why.message}`);
  });
  if (!answer.ok) throw new Error(`${url}: ${answer.status} ${answer.statusText}`);
  return new Uint8Array(await answer.arrayBuffer());
}

export class PalpateView extends HTMLElement {
  static observedAttributes = ["src", "example", "transfer"];

  #viewer;
  #canvas;
  #shown;
  #last = {};
  #wanted = Promise.resolve();

  connectedCallback() {
    if (this.#shown) return;
    const root = this.shadowRoot ?? this.attachShadow({ mode: "open" });
    root.innerHTML =
      "<style>:host { display: block; position: relative; min-height: 200px } " +
      "canvas { position: absolute; inset: 0; width: 100%; height: 100%; touch-action: none; outline: none } " +
      "p { font: 16px/1.5 sans-serif; max-width: 40em; margin: 2em auto; padding: 0 1em; color: #888 }</style>" +
      "<canvas tabindex='0' aria-label='A body that can be pressed on'></canvas>";
    this.#canvas = root.querySelector("canvas");
    this.#shown = this.#begin();
    this.#shown.catch((why) => this.#fail(why));
  }

  disconnectedCallback() {
    const viewer = this.#viewer;
    this.#viewer = undefined;
    this.#shown = undefined;
    viewer?.destroy();
  }

  attributeChangedCallback(name, before, now) {
    if (before === now || !this.#viewer) return;
    this.#open().catch((why) => this.#fail(why));
  }

  async #begin() {
    if (!navigator.gpu || !(await navigator.gpu.requestAdapter())) throw new Error(NO_WEBGPU);
    ready ??= init({ module_or_path: WASM });
    await ready;
    const viewer = new Viewer();
    const src = this.getAttribute("src");
    const example = src ? undefined : (this.getAttribute("example") ?? undefined);
    await viewer.start(this.#canvas, example, (text) => {
      // Not within the frame: whoever listens may call the viewer.
      queueMicrotask(() => this.#told(JSON.parse(text)));
    });
    this.#viewer = viewer;
    if (src) await this.#open();
  }

  /** Without a body there is nothing else to see; with one the viewer's own line says it. */
  #fail(why) {
    const message = why?.message ?? String(why);
    if (!this.#viewer && this.shadowRoot) {
      const said = document.createElement("p");
      said.setAttribute("role", "alert");
      said.textContent = message;
      this.shadowRoot.querySelector("canvas")?.replaceWith(said);
    } else {
      this.#viewer?.say(message);
    }
    this.dispatchEvent(new CustomEvent("error", { detail: { message } }));
  }

  async #open() {
    const src = this.getAttribute("src");
    if (src) await this.load(new URL(src, document.baseURI).href);
  }

  /** Compares a frame with the one before, and tells what is new. */
  #told(frame) {
    const last = this.#last;
    this.#last = frame;
    const tell = (name, detail) => this.dispatchEvent(new CustomEvent(name, { detail }));
    if (last.loading && !frame.loading && !frame.error) tell("load", { name: frame.name, tets: frame.tets });
    if (frame.error && frame.said !== last.said) tell("error", { message: frame.said });
    if (frame.force_n !== null && frame.force_n !== last.force_n) {
      tell("press", { force: frame.force_n, depth: frame.depth_m });
    }
    if (JSON.stringify(frame.camera) !== JSON.stringify(last.camera)) tell("camera", this.camera());
  }

  async #ready() {
    await this.#shown;
    if (!this.#viewer) throw new Error("the element is not in a page");
    return this.#viewer;
  }

  /** Opens what an address, a File or bytes with a name hold. */
  load(what, name) {
    this.#wanted = this.#wanted.catch(() => {}).then(async () => {
      const viewer = this.#viewer ?? (await this.#ready());
      const bytes =
        what instanceof Uint8Array ? what
        : what instanceof ArrayBuffer ? new Uint8Array(what)
        : what instanceof Blob ? new Uint8Array(await what.arrayBuffer())
        : await fetched(what);
      const called = name ?? what.name ?? String(what).split(/[?#]/)[0].split("/").pop();
      viewer.put(called, bytes);
      viewer.open(called, this.getAttribute("transfer") ?? undefined);
    });
    return this.#wanted;
  }

  /** Puts a file ready that a scene names. */
  async put(name, bytes) {
    (await this.#ready()).put(name, new Uint8Array(bytes));
  }

  /** The camera; with one given, looks by it. */
  camera(camera) {
    if (!this.#viewer) return undefined;
    if (camera) this.#viewer.set_camera(JSON.stringify(camera));
    return JSON.parse(this.#viewer.camera());
  }

  /** Presses on what is seen at x, y (0 to 1, to the right and down), so many metres deep. */
  async press(x, y, depth) {
    (await this.#ready()).press(x, y, depth);
  }

  /** Takes the finger out again. */
  async release() {
    (await this.#ready()).release();
  }

  /** The picture as a PNG. */
  async picture(width = 1024, height = 768) {
    const bytes = await (await this.#ready()).picture(width, height);
    return new Blob([bytes], { type: "image/png" });
  }

  /** What is known of the last frame. */
  state() {
    return this.#viewer ? JSON.parse(this.#viewer.state()) : {};
  }
}

customElements.define("palpate-view", PalpateView);
