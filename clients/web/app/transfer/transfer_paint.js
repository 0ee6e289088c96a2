// SPDX-License-Identifier: Apache-2.0
// Draws the transfer function over the histogram, and the strip of its colours below.
import { logHeights } from '../../core/histogram.js';
import { colorAt, opacityAt } from '../../core/transfer.js';
import { themeColor } from '../shell/theme.js';

const css = (color) => `rgb(${color.map((part) => Math.round(part * 255)).join(' ')})`;

/** The histogram as bars, with logarithmic heights. */
function paintHistogram(context, histogram, { width, height, low, high }) {
  const columns = Math.max(1, Math.round(width));
  context.fillStyle = themeColor('--bars');
  context.beginPath();
  context.moveTo(0, height);
  logHeights(histogram, low, high, columns).forEach((part, i) => {
    context.lineTo(i * width / columns, height * (1 - part));
    context.lineTo((i + 1) * width / columns, height * (1 - part));
  });
  context.lineTo(width, height);
  context.fill();
}

/** The colours of the points from `low` to `high`, from left to right. */
function gradientOf(context, points, { width, low, high }) {
  const colors = context.createLinearGradient(0, 0, width, 0);
  const at = (value) => Math.min(1, Math.max(0, (value - low) / (high - low)));
  colors.addColorStop(0, css(colorAt(points, low)));
  for (const { value, color } of points) if (value > low && value < high) colors.addColorStop(at(value), css(color));
  colors.addColorStop(1, css(colorAt(points, high)));
  return colors;
}

/**
 * Paints the histogram (null: none), and above it the opacity as a line over an area in the colours of the points.
 * frame: {width, height, low, high, top}: size in px, the values at the left and right edge, the opacity at the upper edge.
 * Returns the colours, for the strip.
 */
export function paintCurve(context, points, histogram, frame) {
  const { width, height, low, high, top } = frame;
  const xOf = (value) => (value - low) / (high - low) * width;
  const yOf = (opacity) => height * (1 - Math.min(1, opacity / top));
  if (histogram) paintHistogram(context, histogram, frame);
  const line = new Path2D();
  line.moveTo(0, yOf(opacityAt(points, low)));
  for (const { value, opacity } of points) if (value > low && value < high) line.lineTo(xOf(value), yOf(opacity));
  line.lineTo(width, yOf(opacityAt(points, high)));
  const area = new Path2D(line);
  area.lineTo(width, height);
  area.lineTo(0, height);
  const colors = gradientOf(context, points, frame);
  context.globalAlpha = 0.55;
  context.fillStyle = colors;
  context.fill(area);
  context.globalAlpha = 1;
  context.strokeStyle = themeColor('--text');
  context.lineWidth = 1.5;
  context.stroke(line);
  return colors;
}

/** Paints the colours alone into a canvas of one row; width in px. */
export function paintStrip(strip, colors, width) {
  const ratio = window.devicePixelRatio || 1;
  const size = Math.round(width * ratio);
  if (strip.width !== size || strip.height !== 1) [strip.width, strip.height] = [size, 1];
  const context = strip.getContext('2d');
  context.setTransform(ratio, 0, 0, 1, 0, 0);
  context.fillStyle = colors;
  context.fillRect(0, 0, width, 1);
}
