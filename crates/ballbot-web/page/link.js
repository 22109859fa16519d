// The page's choices in its address.

/** Choices from an address, as in `defaults` where it has none, and what it has that is not a choice. */
export function read(hash, defaults) {
  const choices = structuredClone(defaults);
  const unknown = [];
  for (const [name, text] of new URLSearchParams(hash.replace(/^#/, ""))) {
    const [first, second] = name.split(".");
    const [owner, key] = second === undefined ? [choices, first] : [choices[first], second];
    const known = Object.hasOwn(choices, first) && Object.hasOwn(owner, key);
    const value = known ? parsed(text, owner[key]) : undefined;
    if (value === undefined) unknown.push(`${name}=${text}`.slice(0, 60));
    else owner[key] = value;
  }
  return { choices, unknown };
}

/** A text as a value of the kind of another, or undefined. */
function parsed(text, like) {
  const number = (part) => (part.trim() === "" ? NaN : Number(part));
  if (Array.isArray(like)) {
    const numbers = text.split(",").map(number);
    return numbers.length === like.length && numbers.every(Number.isFinite) ? numbers : undefined;
  }
  if (typeof like === "number") return Number.isFinite(number(text)) ? number(text) : undefined;
  if (typeof like === "boolean") return { true: true, false: false }[text];
  return typeof like === "string" ? text.slice(0, 100) : undefined;
}

/** The address of choices, without those that are as in `defaults`. */
export function write(choices, defaults) {
  const out = new URLSearchParams();
  for (const [name, value] of Object.entries(choices)) {
    if (Array.isArray(value)) {
      if (`${value}` !== `${defaults[name]}`) out.set(name, value.map((x) => +x.toFixed(3)).join(","));
    } else if (typeof value === "object") {
      for (const [part, number] of Object.entries(value)) {
        if (number !== defaults[name][part]) out.set(`${name}.${part}`, number);
      }
    } else if (value !== defaults[name]) out.set(name, value);
  }
  return `${out}` ? `#${out}` : "";
}
