// The page's colours: tissue, what was cut, pieces, and cividis, a map that colour-blind eyes read as others do.

// matplotlib's, at 0, 1/16 … 1.
const TABLE = (
  '00224e 002e6a 1a386f 32436d 434e6c 535a6d 61656f 6f7073 7d7c78 8c8878 9b9476 aba072 bcae6c cdbb63 dec958 f0d846 fee838').split(' ').map(hex => [0, 2, 4].map(i => parseInt(hex.slice(i, i + 2), 16) / 255));

// x in [0, 1] to sRGB in [0, 1].
export function cividis(x) {
  const at = Math.min(Math.max(x, 0), 1) * (TABLE.length - 1);
  const i = Math.min(Math.floor(at), TABLE.length - 2), f = at - i;
  return TABLE[i].map((c, k) => c + f * (TABLE[i + 1][k] - c));
}

export const css = ([r, g, b]) => `rgb(${Math.round(255 * r)} ${Math.round(255 * g)} ${Math.round(255 * b)})`;

// By Okabe and Ito where they have to be told apart: vermilion, yellow.
export const TISSUE = [0.86, 0.74, 0.65];
export const CUT_FACE = [0.835, 0.369, 0.0];
export const LOOSE_PIECE = [0.941, 0.894, 0.259];
export const STEEL = [0.60, 0.64, 0.69];

export const variable = name => getComputedStyle(document.documentElement).getPropertyValue(name).trim();
