// The page's choices in its address.

/** Choices from an address; what it does not have, or has wrongly, is as in `defaults`. */
export function read(hash, defaults) {
  const given = new URLSearchParams(hash.replace(/^#/, ""));
  const choices = structuredClone(defaults);
  for (const [name, text] of given) {
    const [first, second] = name.split(".");
    if (second !== undefined && typeof choices[first] === "object" && !Array.isArray(choices[first])) {
      if (Number.isFinite(Number(text))) choices[first][second] = Number(text);
    } else if (Array.isArray(choices[name])) {
      const numbers = text.split(",").map(Number);
      if (numbers.length === choices[name].length && numbers.every(Number.isFinite)) choices[name] = numbers;
    } else if (typeof choices[name] === "number") {
      if (Number.isFinite(Number(text))) choices[name] = Number(text);
    } else if (typeof choices[name] === "boolean") choices[name] = text === "true";
    else if (typeof choices[name] === "string") choices[name] = text.slice(0, 100);
  }
  return choices;
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
  return out.size ? `#${out}` : "";
}
