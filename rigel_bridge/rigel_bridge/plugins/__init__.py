"""The classes that Rigel itself loads. They are built when Rigel asks for them, because each generation brings its own base class."""
