// SPDX-License-Identifier: Apache-2.0
// Gives the modules of core/ the texts of the page, as app/main.js does.
import { useTexts } from '../../../clients/web/core/text.js';
import english from '../../../clients/web/text/en.js';

useTexts(english);
