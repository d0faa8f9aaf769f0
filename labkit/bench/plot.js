// The page's side of labkit.bench.plot, behind figure.js, legend.js, zoom.js and cards.js: everything a bench shows, drawn from one
// message.
//
// From the kernel: {kind: "show", figure, cards, code, idle, plays, ended, status} with arrays as buffers, {kind: "status", status}
// alone while a run is under way or fails, {kind: "veil", veiled}, {kind: "plotly"} with plotly's code. To the kernel: {want},
// {reset}, {click}, {range}, {step}, {lift}.

const FONT = 15;
const ROOM = 1050;  // px of width for which pictures are laid out: with less they would be crowded, with more there is air
const PACE = 600;  // ms between two steps of `play`

const render = ({ model, el }) => {
    el.classList.add("lab-plot");
    make("div", "lab-gone", el, { role: "status", textContent: "The kernel of this bench is gone. Run its cell again to get the bench back." });
    const veil = make("div", "lab-veil", el, { hidden: true });
    make("p", "", veil, { textContent: "First the question above: write down your guess and press “I have decided”." });
    button(veil, "lift", "Show me", "see it without a guess", () => model.send({ lift: true }));
    const alert = make("div", "lab-error-slot", el);
    const bar = make("div", "lab-bar", el);
    const cards = make("div", "lab-metrics", bar);
    const progress = make("progress", "lab-progress", bar, { max: 1, value: 0, hidden: true });
    const transport = make("div", "lab-transport", bar, { hidden: true });
    const back = button(transport, "back", "◀", "one step back", () => step(-1));
    const play = button(transport, "play", "▶", "play", () => (timer ? stop() : start()));
    const forward = button(transport, "forward", "▶❙", "one step forward", () => step(1));
    const buttons = make("div", "lab-buttons", bar);
    button(buttons, "reset", "Reset", "all parameters back to where this bench started", () => model.send({ reset: true }));
    const pin = button(buttons, "pin", "Pin", "keep what is shown now as a pale picture behind what comes", () => togglePin());
    const lecture = button(buttons, "lecture-switch", "Lecture mode", "fills the window, for the last row; Escape leaves it", () => toggleLecture());
    button(buttons, "save", "Save picture", "as a PNG file", () => save());
    const says = make("p", "lab-says", el, { hidden: true });
    const picture = make("div", "lab-picture", el);
    const canvas = make("div", "", picture);
    const news = make("div", "lab-news", el, { role: "status" });
    const code = make("code", "lab-code", el, { title: "copy this line to make the same bench again" });
    const pinnedCode = make("code", "lab-pinned-code", el, { hidden: true });
    const idle = make("p", "lab-idle", el, { hidden: true });
    const more = make("details", "lab-more", el, { hidden: true });
    const count = make("summary", "", more);
    const others = make("div", "lab-others", more);
    const account = make("details", "lab-more", el, { hidden: true });
    make("summary", "", account, { textContent: "all of it in words and numbers" });
    const told = make("pre", "lab-told", account);

    let shown = null, pinned = null, kept = [], large = false, width = 0, height = 0, drawing = false, waiting = false;
    let gone = false, timer = 0, arrived = true, bench = null, fitted = "", settle = () => {};
    const legend = legendOf(canvas, () => draw());
    let aim = null, asked = false, waits = false;  // the newest wish for a window; whether an answer is awaited, a newer wish waits

    const draw = async () => {
        if (drawing) { waiting = true; return; }
        drawing = true;
        try {
            const lib = await plotly(model);
            do {
                waiting = false;
                if (gone || !shown || !width) return;
                const line = code.textContent, { data, layout } = shown.figure;
                const behind = pinned ? ghosts(pinned.figure.data, layout) : [];
                const own = layout.height ?? 460;
                // In lecture mode the picture is laid out as usual and then enlarged as a whole, so that nothing meets that did not.
                const scale = large ? Math.max(0.5, Math.min(height / own, width / ROOM)) : 1;
                const size = large ? { width: Math.floor(width / scale), height: Math.floor(height / scale) } : { width, height: own };
                const first = !canvas.classList.contains("js-plotly-plot");
                canvas.style.transform = large ? `scale(${scale})` : "";
                settle();
                const next = legend.prepare(data, { ...layout, font: { ...layout.font, size: layout.font?.size ?? FONT }, ...size });
                kept = [...data.keys()].filter((i) => draws(data[i]) && !(next.same && isKey(data[i])));
                await lib.react(canvas, [...behind, ...kept.map((i) => next.data[i])], next.layout,
                    { displayModeBar: false, responsive: false, showTips: false });
                legend.keep();
                kept = [...behind.map(() => -1), ...kept];
                picture.dataset.drawn = line;  // whose picture this is
                if (first) listen();
            } while (waiting);
        } finally { drawing = false; }
    };
    const listen = () => {
        canvas.on("plotly_click", ({ points: [point] }) => {
            if (kept[point.curveNumber] >= 0 && point.data.meta?.set) model.send({ click: [kept[point.curveNumber], point.pointNumber] });
        });
        settle = gestures(canvas, () => (shown.figure.layout.meta?.range ? aim ?? shown.figure.layout.xaxis.range : null), wish);
    };
    // A window of the x axis: one wish is on its way at a time, and of those that come meanwhile the newest follows.
    const wish = (range) => {
        aim = range;
        if (asked) { waits = true; return; }
        asked = true;
        model.send({ range });
    };
    const answered = () => {
        asked = false;
        if (!waits) { aim = null; return; }
        waits = false;
        wish(aim);
    };
    const save = () => shown && window.labkitPlotly?.lib?.downloadImage(legend.whole(shown.figure),
        { format: "png", scale: 2, filename: code.textContent.replace(/[^\w.=-]+/g, "_").slice(0, 80) });

    const step = (steps) => { stop(); model.send({ step: steps }); };
    const start = () => {
        put(play, "❚❚");
        arrived = true;
        if (shown?.ended) model.send({ step: 0 });
        timer = setInterval(() => {
            if (shown?.ended) return stop();
            if (!arrived) return;  // the last step is still on its way
            arrived = false;
            model.send({ step: 1 });
        }, PACE);
    };
    const stop = () => {
        clearInterval(timer);
        timer = 0;
        put(play, "▶");
    };

    const togglePin = () => {
        pinned = pinned || !shown ? null : { figure: shown.figure, cards: shown.cards, code: code.textContent };
        put(pin, pinned ? "Unpin" : "Pin");
        pin.ariaPressed = String(!!pinned);
        pinnedCode.hidden = !pinned;
        put(pinnedCode, pinned ? `pinned: ${pinned.code}` : "");
        write();
        draw();
    };

    // The window above the page: the browser's top layer, so that nothing of the notebook clips or covers it.
    const toggleLecture = () => {
        large = !large;
        bench = el.closest(".lab-bench");
        if (large) bench.parentElement.style.minHeight = `${bench.offsetHeight}px`;  // the page below stays where it is
        else bench.parentElement.style.minHeight = "";
        bench.classList.toggle("lab-lecture", large);
        bench.popover = large ? "manual" : null;
        if (large) {
            bench.showPopover();
            window.addEventListener("keydown", leave, true);
        } else window.removeEventListener("keydown", leave, true);
        put(lecture, large ? "Leave" : "Lecture mode");
        lecture.ariaPressed = String(large);
        if (!large) bench.scrollIntoView({ block: "nearest" });
        resize();
    };
    // A choice that is longer than its field is written smaller there. Measuring makes the browser lay out the page, so it is not
    // done for the same choices again; `anew` when the room is another.
    const fit = (anew) => {
        const fields = [...el.closest(".lab-bench")?.querySelectorAll("select") ?? []];
        const chosen = fields.map((field) => field.selectedOptions[0]?.text ?? "").join("\n");
        if (!anew && chosen === fitted) return;
        fitted = chosen;
        const pen = document.createElement("canvas").getContext("2d");
        for (const field of fields) {
            field.style.fontSize = "";
            const { fontSize, fontFamily } = getComputedStyle(field);
            pen.font = `${fontSize} ${fontFamily}`;
            const room = (field.clientWidth - 24) / pen.measureText(field.selectedOptions[0]?.text ?? "").width;
            if (room > 0 && room < 1) field.style.fontSize = `${Math.max(9, Math.floor(parseFloat(fontSize) * room * 10) / 10)}px`;
        }
    };
    const leave = (event) => {
        if (event.key !== "Escape") return;
        event.stopPropagation();
        toggleLecture();
    };

    const write = () => {
        const above = shown.cards.filter((card) => card.headline), below = shown.cards.filter((card) => !card.headline);
        drawCards(cards, above, pinned?.cards);
        drawCards(others, below, pinned?.cards);
        more.hidden = below.length === 0;
        put(count, below.length === 1 ? "one more number" : `${below.length} more numbers`);
        const said = shown.figure.layout.meta?.says;
        says.hidden = said === undefined;
        put(says, said ?? "");
        account.hidden = shown.figure.layout.meta?.told === undefined;
        put(told, shown.figure.layout.meta?.told ?? "");
        transport.hidden = !shown.plays;
        for (const each of [back, play, forward]) each.ariaLabel = `${each.title}: ${shown.plays}`;
        const without = Object.entries(shown.idle);
        idle.hidden = without.length === 0;
        put(idle, without.length ? `without effect now: ${without.map(([name, why]) => `${name} (${why})`).join(", ")}` : "");
    };
    const tell = ({ error, where, progress: done }) => {
        progress.hidden = done === null;
        if (done !== null) progress.value = done;
        el.classList.toggle("lab-stale", done !== null || error !== "");
        tellError(alert, error, where);
        if (error) stop();
    };
    const hide = () => el.closest(".lab-bench")?.classList.toggle("lab-veiled", !veil.hidden);
    const cover = (veiled) => {
        veil.hidden = !veiled;
        hide();
    };

    const take = (message, buffers) => {
        if (message.kind === "plotly") return void load(buffers[0]);
        if (message.kind === "veil") return cover(message.veiled);
        tell(message.status);
        if (message.kind !== "show") {
            if (asked && message.status.error) {  // the window stays what it was
                answered();
                draw();
            }
            return;
        }
        answered();
        arrived = true;
        const figure = unpack(message.figure, buffers);
        put(news, shown ? moved(shown.figure.layout, figure.layout).join(", ") : "");
        shown = { ...message, figure };
        put(code, message.code);
        fit();
        write();
        draw();
    };
    model.on("msg:custom", take);

    const resize = () => {
        hide();  // a busy page puts a bench together after its veil has come
        const { clientWidth, clientHeight } = picture;
        if (!clientWidth || (clientWidth === width && (!large || clientHeight === height) && canvas.style.transform === "" === !large)) return;
        [width, height] = [clientWidth, clientHeight];
        fit(true);
        draw();
    };
    const observer = new ResizeObserver(resize);
    observer.observe(picture);
    hear(model);
    return () => {
        gone = true;
        stop();
        window.removeEventListener("keydown", leave, true);
        model.off("msg:custom", take);
        observer.disconnect();
        window.labkitPlotly?.lib?.purge(canvas);
    };
};

export default { render };
