"""Who may do what: signing, access, refusals."""
