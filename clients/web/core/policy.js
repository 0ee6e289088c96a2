// SPDX-License-Identifier: Apache-2.0
// Describes stream.policy for the user: one line for frames while the view moves, one for the frame at rest.
import { t } from './text.js';

const VIDEO = new Set(['vp8', 'vp9', 'h264', 'av1']);
const REASONS = {
  quality: () => t('policy.quality'),
  bandwidth: ({ moving, final }) => {
    const isSharp = VIDEO.has(moving.format) && !isSmaller(moving, final);
    return t(isSharp ? 'policy.bandwidth.video' : 'policy.bandwidth');
  },
  time: ({ sharp_ms: sharp, budget_ms: budget }) => {
    if (!Number.isFinite(sharp) || !Number.isFinite(budget)) return t('policy.time.long');
    return sharp > budget ? t('policy.time', { sharp: Math.round(sharp), budget: Math.round(budget) }) : t('policy.time.sooner');
  },
  unknown_time: () => t('policy.time.unknown'),
  shared_time: () => t('policy.shared'),
  video_pixels: () => t('policy.video'),
};

const isSmaller = (moving, final) => Boolean(moving.size && final.size && moving.size[0] < final.size[0]);

function describe({ format, quality, subsampling, size, coarse, draft } = {}) {
  if (!format) return '';
  const parts = [format.toUpperCase(), quality === undefined ? t('policy.format.lossless') : t('policy.format.quality', { quality })];
  if (subsampling) parts.push(t('policy.colors', { subsampling }));
  if (size) parts.push(`${size[0]} × ${size[1]}`);
  if (coarse) parts.push(t('policy.coarse', { n: 2 ** coarse }));
  if (draft) parts.push(t('policy.draft'));
  return parts.join(', ');
}

/** policy: params of stream.policy, or null. */
export function policyText(policy) {
  const [moving, final] = [describe(policy?.moving), describe(policy?.final)];
  if (!moving || !final) return '';
  const why = (policy.why ?? []).filter((reason) => Object.hasOwn(REASONS, reason)).map((reason) => REASONS[reason](policy));
  return `${t('policy.moving', { about: moving + (why.length ? ` (${why.join('; ')})` : '') })}\n${t('policy.final', { about: final })}`;
}
