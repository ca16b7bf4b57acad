"""Whether a curiosity method follows the rules, and a template to write one from."""
