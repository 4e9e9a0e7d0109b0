"""Pictures of damped motion; matplotlib is loaded only when one is drawn."""
