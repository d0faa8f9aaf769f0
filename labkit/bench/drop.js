// The page's side of labkit.bench.drop: a strip with a button; a file may be dropped anywhere in the bench.
//
// From the kernel: {kind: "limit", most, folder}, {kind: "more", at}, {kind: "note", text}. To the kernel: {want: "state"},
// {begin: name, size}, {piece: at} with a buffer, {stop}.

const PIECE = 4 << 20;  // bytes in one message; the server takes 10 MiB

const make = (tag, parent, properties = {}) => {
    const made = Object.assign(document.createElement(tag), properties);
    parent.append(made);
    return made;
};
const MB = (bytes) => (bytes / 2 ** 20).toFixed(bytes < 2 ** 20 ? 2 : 0);

const render = ({ model, el }) => {
    el.classList.add("lab-drop");
    const picker = make("input", el, { type: "file", hidden: true, ariaLabel: "file of your own" });
    make("span", el, { textContent: "Drop a file of your own here, or" });
    make("button", el, { type: "button", className: "lab-button", textContent: "choose one", onclick: () => picker.click() });
    const progress = make("progress", el, { max: 1, value: 0, hidden: true });
    const note = make("span", el, { role: "status" });

    let file = null;

    const say = (text) => {
        progress.hidden = true;
        note.textContent = text;
    };
    const give = (files) => {
        [file] = files;
        if (!file) return;
        say(`${file.name} ...`);
        model.send({ begin: file.name, size: file.size });
    };
    const more = async (at) => {
        const source = file;
        if (!source) return;
        try {
            const piece = await source.slice(at, at + PIECE).arrayBuffer();
            if (source !== file) return;
            model.send({ piece: at }, undefined, [piece]);
            progress.hidden = false;
            progress.value = at / source.size;
            note.textContent = `${source.name}: ${MB(at)} of ${MB(source.size)} MiB`;
        } catch {  // a folder, or a file that is gone
            say(`${source.name} cannot be read: it is a folder, or it changed meanwhile`);
            model.send({ stop: true });
        }
    };
    const take = (message) => {
        if (message.kind === "more") more(message.at);
        else if (message.kind === "note") say(message.text);
        else say(`at most ${MB(message.most)} MiB; a copy is kept in the folder ${message.folder} beside the notebook`);
    };
    picker.onchange = () => {
        give(picker.files);
        picker.value = "";
    };

    // On the window, before JupyterLab sees it: a file that misses its place would replace the page.
    const ours = (event) => event.dataTransfer?.types.includes("Files") && el.closest(".lab-bench")?.contains(event.target);
    const over = (event) => {
        const here = ours(event);
        el.classList.toggle("lab-drop-here", !!here && event.type !== "drop");
        if (!here) return;
        event.preventDefault();
        event.stopPropagation();
        if (event.type === "drop") give(event.dataTransfer.files);
    };
    const left = (event) => { if (!event.relatedTarget) el.classList.remove("lab-drop-here"); };
    for (const name of ["dragover", "drop"]) window.addEventListener(name, over, true);
    window.addEventListener("dragleave", left, true);

    model.on("msg:custom", take);
    hear(model);
    return () => {
        for (const name of ["dragover", "drop"]) window.removeEventListener(name, over, true);
        window.removeEventListener("dragleave", left, true);
        model.off("msg:custom", take);
    };
};

export default { render };
