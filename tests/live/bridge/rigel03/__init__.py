"""A contract double of Rigel 0.3: what it promises to plugins, written from its documented behaviour. `rigel/` goes on PYTHONPATH."""
