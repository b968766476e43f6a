// Contrast of each text with its background by the formula of WCAG, lowest first: [ratio, text, colours].
// Disabled buttons are left out, as in WCAG.
(() => {
  const channels = (text) => { const found = text.match(/[\d.]+/g).map(Number); return found.length < 4 ? [...found, 1] : found; };
  const over = (top, below) => [0, 1, 2].map((i) => top[i] * top[3] + below[i] * (1 - top[3])).concat(1);
  const light = (colour) => {
    const [red, green, blue] = colour.map((value) => value / 255)
      .map((value) => (value <= 0.04045 ? value / 12.92 : ((value + 0.055) / 1.055) ** 2.4));
    return 0.2126 * red + 0.7152 * green + 0.0722 * blue;
  };
  const family = (node) => (node ? [node, ...family(node.parentElement)] : []);
  const behind = (node) => family(node).map((one) => channels(getComputedStyle(one).backgroundColor))
    .reduceRight((below, top) => over(top, below), [255, 255, 255, 1]);
  const found = [], texts = document.createTreeWalker(document.body, NodeFilter.SHOW_TEXT);
  while (texts.nextNode()) {
    const text = texts.currentNode.textContent.trim(), node = texts.currentNode.parentElement;
    if (!text || !node.getClientRects().length || node.closest("button:disabled")) continue;
    const style = getComputedStyle(node), ink = channels(node instanceof SVGElement ? style.fill : style.color);
    ink[3] *= family(node).reduce((product, one) => product * getComputedStyle(one).opacity, 1);
    const below = behind(node), both = [light(over(ink, below)), light(below)].sort((a, b) => b - a);
    found.push([(both[0] + 0.05) / (both[1] + 0.05), text, `${ink} on ${below}`]);
  }
  return found.sort((a, b) => a[0] - b[0]);
})()
