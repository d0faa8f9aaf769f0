// What stands around the picture: cards, buttons, errors.

const make = (tag, className, parent, properties = {}) => {
    const made = Object.assign(document.createElement(tag), { className, ...properties });
    parent.append(made);
    return made;
};
const put = (element, text) => { if (element.textContent !== text) element.textContent = text; };
const button = (parent, name, text, title, onclick) =>
    make("button", `lab-button lab-${name}`, parent, { type: "button", textContent: text, title, onclick });

// Cards are made once; afterwards only what differs is written. `was` has those of a pinned result.
const drawCards = (strip, cards, was) => {
    while (strip.children.length > cards.length) strip.lastChild.remove();
    cards.forEach((card, i) => {
        const box = strip.children[i] ?? make("div", "lab-metric", strip, { innerHTML: "<b></b><span></span>" });
        box.className = `lab-metric${card.good === true ? " lab-good" : card.good === false ? " lab-bad" : ""}`;
        if (box.title !== card.note) box.title = card.note;
        const before = was?.find(({ name }) => name === card.name);
        put(box.children[0], card.text);
        put(box.children[1], [card.name, ...card.beside, ...(before ? [`was ${before.text}`] : [])].join(" · "));
        box.classList.toggle("lab-long", card.text.length > 18);
    });
};

const tellError = (slot, error, where) => {
    slot.replaceChildren();
    if (!error) return;
    const box = make("div", "lab-error", slot, { role: "alert", textContent: error });
    if (where) {
        const more = make("details", "", box);
        make("summary", "", more, { textContent: "where" });
        make("pre", "", more, { textContent: where });
    }
};

// A plain key in a bench, such as an arrow on a slider, is not the notebook's; Ctrl+S still is. Jupyter reads this attribute.
window.labkitKeys ??= window.addEventListener("keydown", ({ target, ctrlKey, metaKey, altKey }) => {
    target.closest?.(".lab-bench")?.toggleAttribute("data-lm-suppress-shortcuts", !(ctrlKey || metaKey || altKey));
}, true) ?? true;
