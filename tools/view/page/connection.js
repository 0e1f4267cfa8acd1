// The WebSocket to haptic view, opened again for as long as the page lives.
import { decode } from './protocol.js';

const RETRY_MS = 1000;

export function connect(onMessage, onChange) {
  let socket = null;
  const open = () => {
    socket = new WebSocket(`${location.protocol === 'https:' ? 'wss' : 'ws'}://${location.host}/live`);
    socket.binaryType = 'arraybuffer';
    socket.onopen = () => onChange(true);
    socket.onmessage = event =>
      onMessage(typeof event.data === 'string' ? JSON.parse(event.data) : decode(event.data));
    socket.onclose = () => {
      onChange(false);
      setTimeout(open, RETRY_MS);
    };
  };
  open();
  return { send: value => { if (socket.readyState === WebSocket.OPEN) socket.send(JSON.stringify(value)); } };
}
