// SPDX-License-Identifier: Apache-2.0
// Gives the modules of core/ the texts of the page, as app/main.js does.
import { useTexts } from '../../../clients/web/core/text.js';
import later from '../../../clients/web/text/en/later.js';
import page from '../../../clients/web/text/en/page.js';
import panel from '../../../clients/web/text/en/panel.js';

for (const texts of [page, panel, later]) useTexts(texts);
