"""Add-ons: parts of saf_gen that few people need, each in a folder of its own that can be deleted.

Nothing outside its folder imports an add-on, and no add-on imports another. In the layers, add-ons stand above all the
rest, so an add-on may import anything else, also the terminal and the tables of the command line.

What belongs to the add-on NAME:

- ``saf_gen/addons/NAME/``, its code. ``__init__.py`` holds a docstring and imports nothing.
- ``saf_gen/addons/NAME/commands.py``, the functions of its commands, and ``COMMANDS``: for the words of each command,
  such as ``"live"``, a :class:`saf_gen.cli.command.Command` with the function, examples, the panel of the help that
  lists it, and the line for a user who stops it. Two words, such as ``"sensors fit"``, add a command to a group; the
  help of a group that the core does not have stands in ``GROUPS``. Only this file imports typer and prints.
  ``saf-gen`` imports it at every start, so it imports the rest of the add-on, and whatever is heavy, inside its
  functions.
- ``saf_gen/addons/NAME/scenes/``, if it has any, the scenes that its page and its tests use.
- ``tests/addons/NAME/``, its tests, with the fixtures that only they use in a ``conftest.py``.
- a part of a page in ``docs``, which says how to use it from the command line and from Python.

Which add-ons there are, the command line finds by path: there is no list. To add one, write its folder. To delete one,
delete its folder, its tests and its page, and the links to the page. The rest then works as before, and the commands of
the add-on are unknown; ``tests/addons/test_addons.py`` tries this with each.
"""
