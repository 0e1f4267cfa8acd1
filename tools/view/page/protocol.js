// What haptic view sends in binary (tools/view/frames.h), as typed arrays that look into the message itself.

const HEAD = 24;

export function decode(buffer) {
  const view = new DataView(buffer);
  const kind = view.getUint32(0, true), body = view.getUint32(4, true), count = view.getUint32(8, true);
  const time = view.getFloat64(16, true);
  const floats = (offset, length) => new Float32Array(buffer, offset, length);
  switch (kind) {
    case 1:
      return { kind: 'rest', body, nodes: floats(HEAD, 3 * count) };
    case 2:
      return {
        kind: 'surface', body, removed: view.getUint32(12, true),
        triangles: new Uint32Array(buffer, HEAD, 3 * count),
        flags: new Uint8Array(buffer, HEAD + 12 * count, count),
      };
    case 3:
      return { kind: 'motion', body, time, nodes: floats(HEAD, 3 * count), strain: floats(HEAD + 12 * count, count) };
    case 4: {
      const tools = view.getUint32(12, true), behind = HEAD + 28 * (tools + count);
      return {
        kind: 'contacts', time, instruments: floats(HEAD, 7 * tools), contacts: floats(HEAD + 28 * tools, 7 * count),
        pressing: new Uint8Array(buffer, behind, 2 * count),
      };
    }
    default:
      throw new Error(`a message of unknown kind ${kind}: page and haptic view are of different versions`);
  }
}

export const CUT = 1, LOOSE = 2, PRESSED_TISSUE = 255;
