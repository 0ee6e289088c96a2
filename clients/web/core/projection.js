// SPDX-License-Identifier: Apache-2.0
// Projections: one number of the values along each ray, in grey between the ends of a window.
import { meanAbove } from './histogram.js';

const MODES = ['maximum', 'minimum', 'mean', 'sum'];

/** True if the view shows a projection. */
export const isProjection = (view) => MODES.includes(view?.compositing?.mode);

/** True if the view shows a projection in grey. */
export const isGrey = (view) => isProjection(view) && view.compositing.colors !== 'transfer_function';

/** {center, width} of the window that the daemon chooses; null if the page does not know it. */
function automaticWindow({ mode, absorption, zero }, { windows, histogram }) {
  if (mode === 'sum' && absorption != null) return { center: 0.5, width: 1 };
  const window = windows?.[mode];
  if (!window || mode !== 'sum' || zero == null) return window ?? null;
  const all = meanAbove(histogram, histogram.range[0]);
  const share = all > 0 ? meanAbove(histogram, zero) / all : 0;
  return share > 0 ? { center: window.center * share, width: window.width * share } : { center: 0, width: 1 };
}

/** {level, width} of the window in grey: what is set, and else what the daemon chooses by the histogram (core/histogram.js, null:
    none). Null without a window, or if it cannot be known. */
export function projectionWindow(view, histogram) {
  const { window, ...options } = view?.compositing ?? {};
  if (!isGrey(view)) return null;
  const automatic = automaticWindow(options, { windows: histogram?.windows, histogram });
  const [level, width] = [window?.center ?? automatic?.center, window?.width ?? automatic?.width];
  return level == null || width == null ? null : { level, width };
}

/** The window after a drag by so many steps of `reach`: to the right it gets wider, upwards the level rises. */
export function dragWindow({ level, width }, across, up) {
  return { level: level + up * width, width: width * Math.exp(across) };
}

/** Sheets, as shownAs() says it. */
export const SHEETS = Object.freeze({ mode: 'sheet', center: null, width: null });

/** How the picture is shown, for undo: {mode, center, width}; null = automatic. */
export function shownAs(view) {
  const { mode, window } = view?.compositing ?? {};
  return { mode: mode ?? 'sheet', center: window?.center ?? null, width: window?.width ?? null };
}

/** True if both are the same way to show the picture. */
export const isShownAlike = (a, b) => a.mode === b.mode && a.center === b.center && a.width === b.width;
