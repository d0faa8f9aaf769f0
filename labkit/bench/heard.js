// In front of the code of every widget of ours: see labkit.bench.heard.

// Call once the widget's listeners stand; then ask for what was missed before.
const hear = async (model) => {
    const own = await model.widget_manager.get_model(model.get("address"));
    const base = Object.getPrototypeOf(Object.getPrototypeOf(own));  // ipywidgets' own model class
    own.comm?.on_msg((message) => base._handle_comm_msg.call(own, message));
    model.send({ want: "state" });
};

