/** A camera; lengths are in the units of the file that is open. */
export interface Camera {
  eye: [number, number, number];
  look_at: [number, number, number];
  up: [number, number, number];
  /** Degrees from the lowest ray to the highest; null where rays are parallel. */
  fov?: number | null;
  /** Height of what parallel rays show; null where they are not parallel. */
  orthographic?: number | null;
}

/** What is known of a frame. */
export interface State {
  /** What is open, and what is being opened. */
  name: string | null;
  loading: string | null;
  tets: number;
  steps: number;
  pictures: number;
  /** Simulated time, s. */
  time_s: number;
  playing: boolean;
  /** Force of the press, N, and its depth, m. */
  force_n: number | null;
  depth_m: number | null;
  /** What the status line says, and whether that is an error. */
  said: string;
  error: boolean;
  frame_ms: number;
  ui_ms: number;
  /** Eye, and what it looks at. */
  camera: [[number, number, number], [number, number, number]];
}

/**
 * `<palpate-view src="liver.vtu" transfer="tissue">`.
 *
 * Attributes: `src`, the address of a mesh, a volume, a closed surface or a scene; `example`, the name
 * of a body that ships (limb, knee, heart, head, foot, breast); `transfer`, a preset of colours.
 *
 * Events: `load` ({name, tets}), `error` ({message}), `press` ({force, depth}), `camera` (Camera).
 */
export class PalpateView extends HTMLElement {
  /** Opens what an address, a File or bytes with a name hold. */
  load(what: string | Blob | ArrayBuffer | Uint8Array, name?: string): Promise<void>;
  /** Puts a file ready that a scene names. */
  put(name: string, bytes: ArrayBuffer | Uint8Array): Promise<void>;
  /** The camera; with one given, looks by it. */
  camera(camera?: Camera): Camera | undefined;
  /** Presses on what is seen at x, y (0 to 1, to the right and down), so many metres deep. */
  press(x: number, y: number, depth: number): Promise<void>;
  /** Takes the finger out again. */
  release(): Promise<void>;
  /** The picture as a PNG. */
  picture(width?: number, height?: number): Promise<Blob>;
  /** What is known of the last frame. */
  state(): Partial<State>;
}

declare global {
  interface HTMLElementTagNameMap {
    "palpate-view": PalpateView;
  }
}
