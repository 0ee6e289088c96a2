// SPDX-License-Identifier: Apache-2.0
// Projections: one number of the values along each ray, in grey between the ends of a window.
const MODES = ['maximum', 'minimum', 'mean', 'sum'];

/** True if the view shows a projection. */
export const isProjection = (view) => MODES.includes(view?.compositing?.mode);

/** {level, width} of the window in grey, where it is set or can be told from the range of the values; null otherwise. */
export function projectionWindow(view, range) {
  const { mode, colors, absorption, window } = view?.compositing ?? {};
  if (!isProjection(view) || colors === 'transfer_function') return null;
  if (mode === 'sum' && absorption == null && (window?.center == null || window.width == null)) return null;
  const [low, high] = mode === 'sum' ? [0, 1] : range;
  return { level: window?.center ?? (low + high) / 2, width: window?.width ?? (high > low ? high - low : 1) };
}

/** The window after a drag by so many steps of `reach`: to the right it gets wider, upwards the level rises. */
export function dragWindow({ level, width }, across, up) {
  return { level: level + up * width, width: width * Math.exp(across) };
}

/** The merge patch that sets the window. */
export const windowPatch = ({ level, width }) => ({ compositing: { window: { center: level, width } } });
