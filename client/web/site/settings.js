// Keeps settings as JSON (docs/formats/settings.md) in the browser, and shows them as a form. Names, ranges and
// defaults come from the C++ client.
import {element} from "./dom.js";

const kStore = "lumigrid.settings";
const kVersion = 1;
const kNumber = 0, kInteger = 1, kFlag = 2;

function fieldsOf(core) {
  return core.rows("settings").map(([name, label, ...more]) => {
    const [kind, min, max, value, fallback] = more.map(Number);
    return {name, label, kind, min, max, value, fallback, choices: more[5].split(" "), later: more[6] === "1"};
  });
}

/// Returns a value as the client's number; NaN when the field cannot have it.
function numberOf(field, value) {
  if (field.kind === kFlag) return typeof value === "boolean" ? Number(value) : NaN;
  if (field.kind > kFlag) return field.choices.includes(value) ? field.choices.indexOf(value) : NaN;
  return typeof value === "number" ? value : NaN;
}

/// Hands the stored settings to the client before it starts. Unknown values are skipped: an older or newer page may
/// have written them.
export function restoreSettings(core) {
  let kept;
  try {
    kept = JSON.parse(localStorage.getItem(kStore) ?? "null");
  } catch {
    return;
  }
  if (typeof kept !== "object" || kept === null || kept.version !== kVersion) return;
  for (const field of fieldsOf(core)) {
    const value = kept[field.name];
    const number = numberOf(field, value);
    if (Number.isFinite(number)) core.text("initialSetting", field.name, number);
  }
}

/// Returns the settings that differ from the defaults, as the JSON of docs/formats/settings.md.
function settingsJson(core) {
  const out = {version: kVersion};
  for (const {name, kind, value, fallback, choices} of fieldsOf(core))
    if (value !== fallback)
      out[name] = kind === kFlag ? value !== 0 : kind === kNumber || kind === kInteger ? value : choices[value];
  return JSON.stringify(out);
}

export function keepSettings(core) {
  try {
    localStorage.setItem(kStore, settingsJson(core));
  } catch {
    return "this browser keeps no settings for this page";
  }
  return "";
}

export function settingValue(core, name) {
  const field = fieldsOf(core).find((one) => one.name === name);
  return field?.kind > kFlag ? field.choices[field.value] : field?.value;
}

function inputFor({kind, min, max, value, choices}) {
  if (kind > kFlag)
    return element("select", {}, ...choices.map((choice, i) => new Option(choice, i, false, i === value)));
  if (kind === kFlag) return element("input", {type: "checkbox", checked: value !== 0});
  return element("input", {type: "number", min, max, step: kind === kInteger ? 1 : "any", value});
}

/// Opens the form. `shown`: values by name that replace the stored ones and take effect at once.
export function showSettings(dialog, core, shown, changed) {
  const rows = fieldsOf(core).map((field) => {
    if (field.name in shown) Object.assign(field, {value: field.choices.indexOf(shown[field.name]), later: false});
    const words = element("span", {textContent: field.label});
    if (field.later) words.append(element("small", {textContent: " (after reloading)"}));
    const input = inputFor(field);
    input.name = field.name;
    input.addEventListener("change", () => {
      const value = field.kind === kFlag ? Number(input.checked) : Number(input.value);
      const error = core.text("changeSetting", field.name, value);
      input.setCustomValidity?.(error);
      input.reportValidity?.();
      changed(error, field.name);
    });
    return element("label", {}, words, input);
  });
  dialog.querySelector(".fields").replaceChildren(...rows);
  dialog.showModal();
}
