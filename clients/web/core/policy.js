// SPDX-License-Identifier: Apache-2.0
// What stream.policy says, for people: a line for the picture while the view moves, one for that at rest.

const REASONS = {
  quality: () => 'lower quality keeps it quick',
  time: ({ sharp_ms: sharp, budget_ms: budget }) =>
    (Number.isFinite(sharp) && Number.isFinite(budget)
      ? `full detail would take ${Math.round(sharp)} ms and there are ${Math.round(budget)}` : 'full detail would take too long'),
  unknown_time: () => 'it is not known yet how long full detail takes',
  shared_time: () => 'other sessions move, too',
  video_pixels: () => 'there is no room for more video',
};

function picture({ format, quality, subsampling, size, coarse } = {}) {
  if (!format) return '';
  const parts = [format.toUpperCase() + (quality === undefined ? ', lossless' : `, quality ${quality}`)];
  if (subsampling) parts.push(`colours ${subsampling}`);
  if (size) parts.push(`${size[0]} × ${size[1]}`);
  if (coarse) parts.push(`${2 ** coarse}×${2 ** coarse}×${2 ** coarse} voxels as one`);
  return parts.join(', ');
}

/** policy: params of stream.policy, or null. */
export function policyText(policy) {
  const [moving, final] = [picture(policy?.moving), picture(policy?.final)];
  if (!moving || !final) return '';
  const why = (policy.why ?? []).filter((reason) => Object.hasOwn(REASONS, reason)).map((reason) => REASONS[reason](policy));
  return `Moving: ${moving}${why.length ? ` (${why.join('; ')})` : ''}\nAt rest: ${final}`;
}
