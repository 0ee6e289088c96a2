// SPDX-License-Identifier: Apache-2.0
// Lengths and areas of files that name no unit.
import { t } from './text.js';

/** A length or an area; says so if the file names no unit. */
export const withUnit = (text, unit) => (unit ? text : t('unit.none', { value: text }));
