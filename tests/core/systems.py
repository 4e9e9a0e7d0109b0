"""Systems as the compiled core takes them."""

import numpy as np
import saltus_core as core


def core_of(modes):
    """Flight and contacts of modes."""
    flight, contacts = modes.flight, modes.contacts
    arrays = flight.pairs, flight.mean, flight.delta, flight.matrix
    rows = contacts.gap, contacts.rate, contacts.acceleration, contacts.side, contacts.bound, contacts.push, contacts.restitution
    return (
        core.LinearFlight(*map(np.ascontiguousarray, arrays), np.ones(len(flight.matrix))),
        core.Contacts(*map(np.ascontiguousarray, rows)),
    )
