// SPDX-License-Identifier: Apache-2.0
// For the check of types: elements that are found by a selector or reach a listener can be of any kind, so their properties are not
// checked. The compiler would otherwise ask for a cast in each line.
interface ParentNode {
  querySelector(selectors: string): any;
  querySelectorAll(selectors: string): NodeListOf<any>;
}

interface Element {
  closest(selectors: string): any;
}

interface EventTarget {
  [property: string]: any;
}
