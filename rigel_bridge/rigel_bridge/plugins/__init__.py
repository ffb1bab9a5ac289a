"""The classes that Rigel itself loads. They are built when Rigel imports them, because each generation brings its own base class."""
