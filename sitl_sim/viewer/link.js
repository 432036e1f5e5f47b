// The slider's time is the page's ?t=SECONDS: a link leads to a moment. Not #t=, as in reports:
// viser takes a fragment for a part of its server's address.
// In a handler of an element, names of the document come first: hence window.URL.
const field = () => document.querySelector(".mantine-NumberInput-input");  // beside the slider
const setter = Object.getOwnPropertyDescriptor(HTMLInputElement.prototype, "value").set;
let asked = new URLSearchParams(location.search).get("t");
let written = null;

function step() {
  const input = field();
  if (!input) return;  // the panel is folded, or not there yet
  if (asked !== null) {
    setter.call(input, asked);
    input.dispatchEvent(new Event("input", {bubbles: true}));  // as if it were typed
    asked = null;
  } else if (input.value !== written) {
    written = input.value;
    const address = new window.URL(location.href);
    address.searchParams.set("t", written);
    history.replaceState(null, "", address);
  }
}

if (!window.linked) {  // once a page
  window.linked = true;
  setInterval(step, 500);
}
